"""Reconstruction by RTK's filtered back-projection (FDK); run by the environment that holds ``itk-rtk``.

    python rtk_fdk.py JOB.json

JOB.json names the radiographs (.npy, line integrals) and the volume to write (.npy), and gives the circular
cone-beam scan over the full circle.  RTK turns about its y axis with the source at +z for angle 0, so that
its (x, y, z) are (x, z, −y) of grainmotion's frame: the volume's axes [−y, z, x] become [z, y, x].  The panel
needs no change.  ``hann`` is the cut-off of the Hann window over the ramp filter as a share of Nyquist's
frequency, 0 for the plain ramp.
Prints {"cpu": seconds, "version": ...}: user and system time of all threads in the filter alone.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import itk
import numpy as np
from rtk_scene import centred, circular

rtk = itk.RTK
job = json.loads(Path(sys.argv[1]).read_text())
radiographs = np.load(job["radiographs"]).astype(np.float32)
h, pixel = job["voxel_size"], job["pixel_size"]
nz, ny, nx = job["shape"]

geometry = circular(job)

fdk = rtk.FDKConeBeamReconstructionFilter[itk.Image[itk.F, 3]].New()
fdk.SetGeometry(geometry)
fdk.SetInput(0, centred(np.zeros((ny, nz, nx), np.float32), [h, h, h]))
fdk.SetInput(1, centred(radiographs, [pixel, pixel, 1.0]))
fdk.GetRampFilter().SetTruncationCorrection(0.0)
fdk.GetRampFilter().SetHannCutFrequency(job["hann"])

start = time.process_time()
fdk.Update()
cpu = time.process_time() - start

found = itk.array_from_image(fdk.GetOutput())
np.save(job["out"], np.ascontiguousarray(found[::-1].transpose(1, 0, 2)))
print(json.dumps({"cpu": cpu, "version": version("itk-rtk")}))
