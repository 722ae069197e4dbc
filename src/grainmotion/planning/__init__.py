"""What `plan` is made of: candidate views, their information, the choice among them, the capture to expect."""
