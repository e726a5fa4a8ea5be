"""froxel_ref: a reference for froxel volumetric lighting, in plain NumPy."""

__version__ = "0.1.0"
