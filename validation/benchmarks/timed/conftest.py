"""Description of the machine in the kept history: enough to compare times, nothing that identifies it."""

from importlib.metadata import version


def pytest_benchmark_update_machine_info(config, machine_info):
    """Processor, system and versions; no host's name, no list of the processor's features."""
    cpu = machine_info.get("cpu", {})
    kept = {key: machine_info[key] for key in ("machine", "python_version", "system") if key in machine_info}
    machine_info.clear()
    machine_info.update(kept, processor=cpu.get("brand_raw", ""), cores=cpu.get("count", 0))
    machine_info["versions"] = {name: version(name) for name in ("grainmotion", "numba", "numpy", "scipy")}


def pytest_benchmark_update_commit_info(config, commit_info):
    """The commit alone."""
    for key in ("branch", "project"):
        commit_info.pop(key, None)
