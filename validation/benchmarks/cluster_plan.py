"""A run of 2000³ voxels and 20,000 grains on a cluster, on paper: bytes and seconds of each stage.

    python -m validation.benchmarks.cluster_plan [--size 2000] [--grains 20000] [--threads 16]

The formulas are those of `models.stages`.  Seconds of a voxel, pixel or view come from the largest run that
`workers.py` measured; the bytes of all its runs are compared with the formulas.  Writes
``validation/benchmarks/results/cluster_plan.md``; ends with code 1 if a formula is off by more than a factor of 2 in
bytes that matter (1 % of the largest of its kind).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from validation.benchmarks.models.stages import Cost, Plan, Rates, costs, diameter_of
from validation.benchmarks.packed_cylinder import RADIUS
from validation.benchmarks.peers.environment import machine

RESULT_FOLDER = Path(__file__).parent / "results"
NETWORK, STORAGE = 1.25e9, 2e9
"""Bytes a second into or out of a node, and from and to the shared storage in all."""
NODES, NODE_BYTES = (8, 16), (64e9, 128e9)
MOST_OFF, THAT_MATTERS = 2.0, 0.01


def measured() -> list[dict[str, Any]]:
    """The runs that `workers.py` left, the largest last."""
    found = [json.loads(path.read_text()) for path in RESULT_FOLDER.glob("workers*.json")]
    if not found:
        raise SystemExit("run `python -m validation.benchmarks.workers` before")
    return sorted(found, key=lambda each: int(each["size"]))


def plan_of(run: dict[str, Any], workers: int) -> Plan:
    """The size of a measured run."""
    return Plan(run["size"], run["size"], run["grains"], 2 * RADIUS, workers)


def rates_of(run: dict[str, Any]) -> Rates:
    """CPU seconds of a pixel, view, voxel and so on, from a run by one worker."""
    plan, stages = plan_of(run, 1), run["runs"]["1"]["stages"]
    total = {name: stage["client"] + sum(stage["workers"]) for name, stage in stages.items()}
    return Rates(
        start=sum(stages["reading, checks"]["workers"]),
        pixel=stages["reading, checks"]["client"] / plan.pixels,
        view=total["calibration"] / plan.views,
        sample=total["reconstruction"] / (plan.voxels * plan.walked),
        voxel=total["segmentation"] / plan.voxels,
        fine=sum(stages["cutting"]["workers"]) / (plan.grains * plan.crop * 8),
        tracked=total["tracking"] / (plan.grains * plan.diameter**3),
    )


def compared(run: dict[str, Any], rates: Rates) -> tuple[list[str], float]:
    """Lines of the table of formulas and measurements of one size, and how far bytes are off at most."""
    rows, worst = [], 1.0
    counts = [int(count) for count in run["runs"] if int(count) > 1]
    for workers in sorted(counts):
        stages = run["runs"][str(workers)]["stages"]
        modelled = {cost.name: cost for cost in costs(plan_of(run, workers), rates)}
        largest = {key: max(stage[key] for stage in stages.values()) for key in ("between", "read", "written")}
        for name, cost in modelled.items():
            stage = stages[name]
            files = stage["read"] + stage["written"]
            cells = []
            for told, found, most in (
                (cost.between, stage["between"], largest["between"]),
                (cost.files, files, largest["read"] + largest["written"]),
            ):
                ratio = told / found if found else float("nan")
                cells.append(f"{told / 1e6:.0f} / {found / 1e6:.0f}" + (f" = {ratio:.2f}" if found > 1e6 else ""))
                if found > THAT_MATTERS * most and told:
                    worst = max(worst, ratio, 1 / ratio)
            seconds = stage["client"] + sum(stage["workers"])
            spent = cost.client_seconds + cost.worker_seconds
            cells.append(f"{spent:.1f} / {seconds:.1f} = {spent / max(seconds, 1e-9):.2f}")
            rows.append(f"| {run['size']}³, {workers} | {name} | " + " | ".join(cells) + " |")
    return rows, worst


def planned(plan: Plan, rates: Rates) -> list[str]:
    """Lines of the table of one cluster."""
    rows = []
    for cost in costs(plan, rates):
        hours = cost.seconds(plan.threads, NETWORK, STORAGE, plan.workers) / 3600
        files = cost.files + cost.mapped
        cells = [
            cost.name, *(f"{value / 1e9:.1f}" for value in (cost.client, cost.worker, cost.between, files)),
            f"{cost.client_seconds / 3600:.2f}", f"{cost.worker_seconds / 3600:.1f}", f"{hours:.2f}",
        ]  # fmt: skip
        rows.append(f"| {' | '.join(cells)} |")
    every = costs(plan, rates)
    total = sum(cost.seconds(plan.threads, NETWORK, STORAGE, plan.workers) for cost in every) / 3600
    rows.append(
        f"| **all** | {max(c.client for c in every) / 1e9:.0f} | {max(c.worker for c in every) / 1e9:.0f} "
        f"| {sum(c.between for c in every) / 1e9:.0f} | {sum(c.files + c.mapped for c in every) / 1e9:.0f} "
        f"| {sum(c.client_seconds for c in every) / 3600:.1f} | {sum(c.worker_seconds for c in every) / 3600:.0f} "
        f"| {total:.1f} |"
    )
    return rows


def verdict(every: list[Cost]) -> list[str]:
    """What does not fit into a node, said plainly."""
    lines = []
    for size in NODE_BYTES:
        short = [f"{cost.name} ({cost.client / 1e9:.0f} GB)" for cost in every if cost.client > 0.9 * size]
        node = f"A client of {size / 1e9:.0f} GB"
        lines.append(
            f"- {node} is too small for {', '.join(short)}: volume and labels are then kept in mapped files beside "
            "the results (decision 0053), which takes as long as the storage needs."
            if short
            else f"- {node} suffices."
        )
    return lines


def main() -> int:
    """Write the table, and say whether the formulas agree with what was measured."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=2000, help="edge of the volume, voxels")
    parser.add_argument("--grains", type=int, default=20_000)
    parser.add_argument("--threads", type=int, default=16, help="of each node")
    options = parser.parse_args()
    runs = measured()
    rates, worst = rates_of(runs[-1]), 1.0
    rows: list[str] = []
    for run in runs:
        lines, off = compared(run, rates)
        rows, worst = rows + lines, max(worst, off)
    diameter = diameter_of(options.size, options.grains)
    head = (
        "| stage | client holds, GB | a worker holds, GB | between workers, GB | files, GB | client, CPU h "
        "| workers, CPU h | expected, h |"
    )
    tables, every = [], []
    for nodes in NODES:
        plan = Plan(options.size, options.size, options.grains, diameter, nodes, options.threads)
        every = costs(plan, rates)
        tables += [f"### {nodes} nodes of {options.threads} threads", "", head, "|---" * 8 + "|"]
        tables += [*planned(plan, rates), ""]
    text = "\n".join(
        [
            f"# {options.size}³ voxels and {options.grains:,} grains on a cluster, on paper",
            "",
            f"{options.size:,} views of {options.size:,} × {options.size:,} pixels, grains {diameter:.0f} voxels "
            "across, one later state of 4 views.",
            "The client is one more process on one of the nodes, with as many threads.  *Files* are read and written",
            f"on shared storage by all.  Assumed: {NETWORK / 1e9:g} GB/s a node, {STORAGE / 1e9:g} GB/s of storage.",
            f"CPU times follow from the run of {runs[-1]['size']}³ voxels by one worker.",
            "",
            *tables,
            *verdict(every),
            "",
            "## Formulas against what was measured",
            "",
            "Formula / measured = their ratio, by workers of one thread.  What workers send to the client counts as",
            "between workers; checks of the grains are in tracking.",
            "",
            "| N³, workers | stage | between workers, MB | files, MB | CPU s |",
            "|---|---|---|---|---|",
            *rows,
            "",
            f"Bytes that matter are off by a factor of {worst:.2f} at most (bar {MOST_OFF:g}: "
            f"{'met' if worst <= MOST_OFF else 'MISSED'}).",
            "",
            f"{machine()}.  Made by `python -m validation.benchmarks.cluster_plan --size {options.size} "
            f"--grains {options.grains} --threads {options.threads}`.",
            "",
        ]
    )
    (RESULT_FOLDER / "cluster_plan.md").write_text(text)
    print(text)
    return 0 if worst <= MOST_OFF else 1


if __name__ == "__main__":
    sys.exit(main())
