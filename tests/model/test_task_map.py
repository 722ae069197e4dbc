"""Independent calls are made here, or by whoever shares them out, and their results come in order."""

from grainmotion.model.task_map import each, is_shared, shared_among


def double(number):
    return 2 * number


def backwards(function, items):
    """Makes the calls in another order."""
    return [function(item) for item in reversed(list(items))][::-1]


def test_calls_are_made_in_order_without_workers():
    assert not is_shared()
    assert each(double, [1, 2, 3]) == [2, 4, 6]
    assert each(double, (k for k in (1, 2))) == [2, 4]


def test_others_make_the_calls_within_a_block():
    with shared_among(backwards):
        assert is_shared()
        assert each(double, [1, 2, 3]) == [2, 4, 6]
    assert not is_shared()
