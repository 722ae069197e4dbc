"""DiffDRR's Siddon renderer forward and backward; run by the environment that holds ``diffdrr`` and ``torch``.

    python diffdrr_siddon.py JOB.json

JOB.json names arrays (.npy): a grain's voxels [z, y, x], the source of a view and the pixels' centres (x y z, mm,
sample frame), and measured line integrals; and gives the voxel size, the grain's ``corner`` (voxel [0, 0, 0] seen
from its centre), its moved centre ``position``, its rotation ``matrix`` and the precision.  Rays are carried into the
grain's voxels as `diffdrr.drr.render` carries them, by x → Ωᵀ exp[−δ]ₓ (x − position − u); the loss is ½ Σ (I − b)².
Only the renderer is imported: the rest of the package reads and shows medical images.

Writes ``out`` (.npy), the line integrals.  Prints {"cpu": seconds, "gradient": by u and δ, ...}: user and system time
of all threads in one forward and backward, the least of ``repeats`` with one thread and as many with all cores,
after a first one that does not count.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from diffdrr.renderers import Siddon

job = json.loads(Path(sys.argv[1]).read_text())
precision = {"single": torch.float32, "double": torch.float64}[job["precision"]]


def tensor(values):
    return torch.as_tensor(np.ascontiguousarray(values), dtype=precision)


density = tensor(np.load(job["volume"]).transpose(2, 1, 0))  # x y z
source = tensor(np.load(job["source"])).reshape(1, 1, 3)
target = tensor(np.load(job["pixels"])).reshape(1, -1, 3)
measured = tensor(np.load(job["measured"])).reshape(1, 1, -1)
corner, position, matrix = tensor(job["corner"]), tensor(job["position"]), tensor(job["matrix"])
threads = torch.get_num_threads()
# A nearest voxel has no derivative: without these gradients, which are zero, DiffDRR is faster.
renderer = Siddon(stop_gradients_through_grid_sample=True)


def render(u, delta):
    """Line integrals of the grain after a motion (u, δ) more."""
    x, y, z = delta.unbind()
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)
    rotation = torch.linalg.matrix_exp(cross) @ matrix

    def to_voxels(points):
        return ((points - position - u) @ rotation - corner) / job["voxel_size"]

    lengths = (target - source).norm(dim=-1).unsqueeze(1)
    return renderer(density, to_voxels(source), to_voxels(target), lengths)


times = []
for k in range(2 * job["repeats"] + 1):
    torch.set_num_threads(1 if k % 2 else threads)
    u, delta = torch.zeros(3, dtype=precision, requires_grad=True), torch.zeros(3, dtype=precision, requires_grad=True)
    start = time.process_time()
    values = render(u, delta)
    loss = 0.5 * ((values - measured) ** 2).sum()
    loss.backward()
    times.append(time.process_time() - start)

np.save(job["out"], values.detach().numpy().ravel())
reply = {
    "cpu": min(times[1:]),
    "gradient": [*u.grad.tolist(), *delta.grad.tolist()],
    "diffdrr": version("diffdrr"),
    "torch": version("torch"),
}
print(json.dumps(reply))
