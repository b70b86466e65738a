"""Image files of a detector: PNG, TIFF or FITS as index values 0..4096."""

import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from gse.errors import TableError

INDEX_BITS = 12
MAX_FILE_BYTES = 512_000_000
MAX_PIXELS = 67_108_864
"""8192 x 8192: larger than any detector of a star sensor, small enough for any host."""

_FITS_SUFFIXES = (".fits", ".fit", ".fts")
_KNOWN_SUFFIXES = (".png", ".tif", ".tiff", *_FITS_SUFFIXES)
_DEPTHS = {"1": 8, "L": 8, "P": 8, "RGB": 8, "RGBA": 8, "LA": 8, "I;16": 16, "I;16B": 16, "I;16L": 16, "I": 16, "F": 16}
_EXPECTED = "expected gray of 8, 12 or 16 bits, or colour of 8"
_BITS_PER_SAMPLE = 258
"""The TIFF tag."""
_BROKEN = (OSError, SyntaxError, ValueError, TypeError, KeyError, IndexError, EOFError, struct.error, MemoryError)
"""What Pillow and astropy raise on damaged files."""


def read_image(path: Path, bits: int | None = None) -> NDArray[np.uint16]:
    """Index values (rows, columns), 0..4096, of an image file, its rows in the order of the file.

    ``bits`` is how many bits of the stored values count. Without it that is the file's depth, but 12 where a file of
    16 bits holds nothing over 4096. TableError otherwise, with what came and what was expected.
    """
    suffix = path.suffix.lower()
    if suffix not in _KNOWN_SUFFIXES:
        raise TableError(f"{path} is not an image of a known format: expected {', '.join(_KNOWN_SUFFIXES)}")
    if path.exists() and not path.is_file():
        raise TableError(f"{path} is a folder, a pipe or a device: expected an image file")
    try:
        size = path.stat().st_size
    except OSError as error:
        raise TableError(f"cannot read {path}: {error.strerror}") from error
    if size > MAX_FILE_BYTES:
        raise TableError(f"{path} is larger than {MAX_FILE_BYTES} bytes: this is not an image of a star sensor")
    values, depth = _read_fits(path) if suffix in _FITS_SUFFIXES else _read_picture(path)
    if values.dtype.kind == "f":
        _check_floats(path, values)
    return _index_values(values, depth if bits is None else bits, is_given=bits is not None)


def _check_floats(path: Path, numbers: NDArray[Any]) -> None:
    brightest = float(np.max(numbers, where=np.isfinite(numbers), initial=-np.inf))
    if brightest == -np.inf:
        raise TableError(f"{path} holds no number in any pixel")
    if 0 < brightest <= 1:
        raise TableError(f"{path} holds fractions up to {brightest:.3g}: expected counts, so scale it to 0..4095")


def _index_values(numbers: NDArray[Any], bits: int, *, is_given: bool) -> NDArray[np.uint16]:
    if bits == 16 and not is_given and np.max(numbers, where=np.isfinite(numbers), initial=0) <= 1 << INDEX_BITS:
        bits = INDEX_BITS
    if numbers.dtype.kind == "f":
        numbers = np.nan_to_num(numbers, nan=0.0, posinf=2.0**bits - 1, neginf=0.0)
    if numbers.dtype == np.uint8:
        return np.left_shift(numbers.astype(np.uint16), INDEX_BITS - min(bits, 8), dtype=np.uint16)
    if numbers.dtype == np.uint16 and bits >= INDEX_BITS:
        return np.asarray(np.minimum(numbers >> (bits - INDEX_BITS), 1 << INDEX_BITS), dtype=np.uint16)
    scaled = np.floor(numbers * 2.0 ** (INDEX_BITS - bits))
    return np.asarray(np.clip(scaled, 0, 1 << INDEX_BITS), dtype=np.uint16)


def _read_picture(path: Path) -> tuple[NDArray[Any], int]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged metadata, and of a size that is checked here
            with Image.open(path, formats=("PNG", "TIFF")) as picture:
                _check_size(path, *picture.size)
                depth = _depth(picture, path)
                gray = picture if depth > 8 or picture.mode == "L" else picture.convert("L")
                return np.asarray(gray), depth
    except UnidentifiedImageError as error:
        raise TableError(f"{path} is not a PNG or TIFF image of a known kind: {_EXPECTED}") from error
    except Image.DecompressionBombError as error:
        raise TableError(_too_large(path)) from error
    except _BROKEN as error:
        raise _damaged(path, error) from error


def _depth(picture: Image.Image, path: Path) -> int:
    if picture.mode not in _DEPTHS:
        raise TableError(f"{path} holds pixels of kind {picture.mode}: {_EXPECTED}")
    depth = _DEPTHS[picture.mode]
    tags = getattr(picture, "tag_v2", None)
    if tags is None:
        return depth
    bits = int(tags.get(_BITS_PER_SAMPLE, (depth,))[0])
    if depth == 8 < bits:
        # Pillow reads some of these, and some wrong.
        raise TableError(f"{path} holds colours of {bits} bits: {_EXPECTED}")
    return depth if depth == 8 else min(bits, 16)


def _read_fits(path: Path) -> tuple[NDArray[Any], int]:
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyWarning

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AstropyWarning)  # what cannot be read raises besides
            with path.open("rb") as file, fits.open(file, memmap=False) as units:
                for unit in units:
                    header = unit.header
                    if unit.is_image and header.get("NAXIS") == 2:
                        _check_size(path, int(header["NAXIS1"]), int(header["NAXIS2"]))
                        data = np.asarray(unit.data)
                        return data.astype(data.dtype.newbyteorder("=")), 8 if data.dtype.itemsize == 1 else 16
    except (*_BROKEN, fits.VerifyError) as error:
        raise _damaged(path, error) from error
    raise TableError(f"{path} holds no two-dimensional image")


def _check_size(path: Path, columns: int, rows: int) -> None:
    if columns * rows > MAX_PIXELS:
        raise TableError(_too_large(path))
    if columns < 1 or rows < 1:
        raise TableError(f"{path} holds no pixels")


def _too_large(path: Path) -> str:
    return f"{path} holds more than {MAX_PIXELS} pixels: this is not an image of a star sensor"


def _damaged(path: Path, error: BaseException) -> TableError:
    reason = (str(error) or type(error).__name__).splitlines()[0][:120]
    return TableError(f"{path} is damaged or no image: {reason}")
