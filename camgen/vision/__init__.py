"""From a photo to outlines in mm: camera, work plane, to-scale view, part mask, sub-pixel contours (PIST)."""
