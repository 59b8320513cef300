"""From a photo to outlines in mm: camera, work plane, rectified view, mask and contours (PIST)."""
