"""What the scripts that call RTK share: images about the origin, and a circular scan."""

import itk


def centred(array, spacing):
    """An ITK image whose middle is the origin."""
    image = itk.image_from_array(array)
    image.SetSpacing(spacing)
    image.SetOrigin([-(n - 1) / 2 * s for n, s in zip(array.shape[::-1], spacing)])
    return image


def circular(job):
    """RTK's geometry of a job's views."""
    geometry = itk.RTK.ThreeDCircularProjectionGeometry.New()
    for angle in job["angles_deg"]:
        geometry.AddProjection(job["source_to_axis"], job["source_to_detector"], angle)
    return geometry
