"""Forward projection by RTK's Joseph projector; run by the environment that holds ``itk-rtk``.

    python rtk_joseph.py JOB.json

JOB.json names the volume and the radiographs to write (.npy) and gives the circular cone-beam scan.
RTK turns about its y axis with the source at +z for angle 0, so that its (x, y, z) are (x, z, −y) of
grainmotion's frame: the volume's axes [z, y, x] become [−y, z, x].  The panel needs no change.
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
volume = np.ascontiguousarray(np.load(job["volume"]).transpose(1, 0, 2)[::-1], dtype=np.float32)
rows, columns = job["panel"]
h, pixel = job["voxel_size"], job["pixel_size"]

geometry = circular(job)

image_type = itk.Image[itk.F, 3]
panels = centred(np.zeros((len(job["angles_deg"]), rows, columns), np.float32), [pixel, pixel, 1.0])
projector = rtk.JosephForwardProjectionImageFilter[image_type, image_type].New()
projector.SetGeometry(geometry)
projector.SetInput(0, panels)
projector.SetInput(1, centred(volume, [h, h, h]))

start = time.process_time()
projector.Update()
cpu = time.process_time() - start

np.save(job["out"], itk.array_from_image(projector.GetOutput()))
print(json.dumps({"cpu": cpu, "version": version("itk-rtk")}))
