"""One sweep of RTK's SART over all views; run by the environment that holds ``itk-rtk``.

    python rtk_sart.py JOB.json

JOB.json names the radiographs (.npy, line integrals) and the volume to write (.npy), gives the circular cone-beam
scan, the relaxation λ and which back-projector to take: "joseph", the adjoint of the forward projector, or "voxels",
RTK's default.  The forward projector is Joseph's.  RTK turns about its y axis with the source at +z for angle 0, so
that its (x, y, z) are (x, z, −y) of grainmotion's frame: the volume's axes [−y, z, x] become [z, y, x].  The panel
needs no change.
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

image_type = itk.Image[itk.F, 3]
sart = rtk.SARTConeBeamReconstructionFilter[image_type, image_type].New()
sart.SetGeometry(circular(job))
sart.SetInput(0, centred(np.zeros((ny, nz, nx), np.float32), [h, h, h]))
sart.SetInput(1, centred(radiographs, [pixel, pixel, 1.0]))
sart.SetForwardProjectionFilter(sart.ForwardProjectionType_FP_JOSEPH)
backs = {"joseph": sart.BackProjectionType_BP_JOSEPH, "voxels": sart.BackProjectionType_BP_VOXELBASED}
sart.SetBackProjectionFilter(backs[job["back_projector"]])
sart.SetNumberOfIterations(1)
sart.SetNumberOfProjectionsPerSubset(1)
sart.SetLambda(job["relaxation"])
sart.SetEnforcePositivity(True)
sart.SetDisableDisplacedDetectorFilter(True)

start = time.process_time()
sart.Update()
cpu = time.process_time() - start

found = itk.array_from_image(sart.GetOutput())
np.save(job["out"], np.ascontiguousarray(found[::-1].transpose(1, 0, 2)))
print(json.dumps({"cpu": cpu, "version": version("itk-rtk")}))
