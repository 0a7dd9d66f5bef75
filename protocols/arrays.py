"""Types of arrays that the decoders share."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

INT64, UINT8 = np.dtype(np.int64), np.dtype(np.uint8)  # a dtype is found sooner than a type; for loops over frames

Array = NDArray[Any]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
