"""An executor that runs every task at once in this process, for tests without a cluster."""

import pickle


class InlineExecutor:
    """Literals and results are pickled, as they would be between processes."""

    def __init__(self, worker_count=2):
        self.done, self.worker_count = [], worker_count

    def task(self, function, /, *tasks, **literals):
        self.done.append(function.__name__)
        return function(*tasks, **pickle.loads(pickle.dumps(literals)))

    def addresses(self, count):
        return [""] * count

    def task_at(self, address, function, /, *tasks, **literals):
        return self.task(function, *tasks, **literals)

    def persist(self, tasks):
        return list(tasks)

    def results(self, tasks):
        return pickle.loads(pickle.dumps(list(tasks)))

    def in_order(self, tasks):
        return map(pickle.loads, map(pickle.dumps, tasks))

    def as_completed(self, more):
        while (task := more()) is not None:
            yield pickle.loads(pickle.dumps(task))
