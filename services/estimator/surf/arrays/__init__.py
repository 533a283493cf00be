"""Detection and description on whole arrays: the same as the compiled loops give, on a GPU where there is one.

Written in the functions of the Python array API standard alone, so that one text runs on CuPy, PyTorch and NumPy.
"""

from services.estimator.surf.arrays.device import Device, find_gpu, numpy_device
from services.estimator.surf.arrays.extraction import extract

__all__ = ["Device", "extract", "find_gpu", "numpy_device"]
