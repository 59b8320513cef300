"""Where a CAD part stands in a point cloud: a coarse search from everywhere, an exact fit, and what speaks against it.

``finding.localize`` is the walk; ``scans`` and ``records`` read clouds, ``starts`` and ``coarse`` search,
``nearest`` and ``fine`` refine, ``doubt`` looks for other poses that fit as well.
"""
