"""Makes the files here with tifffile, and what a reader must find in them.

    pip install numpy tifffile imagecodecs && python make.py

`expected.tsv` has one line a field: file, time step, field, number type, components, points in x, y,
z, spacing in x, y, z, and two sums over all numbers in order of memory (component fastest, then x,
y, z): plain, and weighted with 1 + position modulo 97. The sums are those of the arrays before they
were written, and each file is read back with tifffile to see that it holds them.
"""

import os

import numpy as np
import tifffile

HERE = os.path.dirname(os.path.abspath(__file__))
os.chdir(HERE)
random = np.random.default_rng(11)
lines = []


def values(code, *shape):
    kind = np.dtype(code)
    if kind.kind in "ui":
        top = min(np.iinfo(kind).max, 2**40)
        return random.integers(0 if kind.kind == "u" else -top, top, shape).astype(kind)
    # Smooth, with exact sums.
    grid = np.indices(shape).sum(axis=0)
    return (np.round(100 * np.sin(0.2 * grid)) / 8 + 3).astype(kind)


def expect(name, volume, spacing=(1, 1, 1), step=0, field="scalars"):
    """volume: (z, y, x) or (z, y, x, components)."""
    if volume.ndim == 3:
        volume = volume[..., None]
    z, y, x, components = volume.shape
    kind = "f32" if volume.dtype == np.float16 else f"{volume.dtype.kind}{8 * volume.dtype.itemsize}"
    flat = np.ascontiguousarray(volume).ravel()
    # Python's integers are exact, and so are these floats.
    numbers = [int(v) if volume.dtype.kind in "ui" else float(v) for v in flat]
    plain = float(sum(numbers))
    weighted = float(sum(v * (i % 97 + 1) for i, v in enumerate(numbers)))
    words = [name, step, field, kind, components, x, y, z, *map(float, spacing), plain, weighted]
    lines.append("\t".join(w if isinstance(w, str) else repr(w) for w in words))


def check(name, array):
    read = tifffile.imread(name)
    assert read.size == array.size and np.array_equal(read.ravel(), array.ravel()), name


# ImageJ: channels, slices, frames, spacing.
stack = values("<u2", 2, 3, 2, 6, 7)  # T Z C Y X
tifffile.imwrite("imagej_hyperstack.tif", stack, imagej=True, resolution=(4.0, 2.0),
                 metadata={"axes": "TZCYX", "spacing": 1.5, "unit": "um", "finterval": 0.25})
check("imagej_hyperstack.tif", stack)
for t in range(2):
    for c in range(2):
        expect("imagej_hyperstack.tif", stack[t, :, c], (0.25, 0.5, 1.5), t, f"channel_{c + 1}")

# ImageJ: one directory for all images, in its big-endian order.
stack = values(">u2", 5, 6, 7)
tifffile.imwrite("imagej_one_directory.tif", stack, imagej=True, truncate=True,
                 metadata={"axes": "ZYX", "spacing": 0.5, "unit": "nm"})
with tifffile.TiffFile("imagej_one_directory.tif") as file:
    assert len(file.pages) == 1 and file.byteorder == ">"
check("imagej_one_directory.tif", stack)
expect("imagej_one_directory.tif", stack, (1, 1, 0.5))

# ImageJ: RGB.
stack = values("u1", 3, 5, 4, 3)
tifffile.imwrite("imagej_rgb.tif", stack, imagej=True, metadata={"axes": "ZYXS", "spacing": 2.0})
check("imagej_rgb.tif", stack)
expect("imagej_rgb.tif", stack, (1, 1, 2))

# OME: slices and channels, sizes in two units.
stack = values("<u2", 2, 4, 6, 5)  # C Z Y X
tifffile.imwrite("ome_channels.ome.tif", stack, ome=True, compression="zlib", metadata={
    "axes": "CZYX", "PhysicalSizeX": 0.2, "PhysicalSizeXUnit": "µm", "PhysicalSizeY": 0.25,
    "PhysicalSizeYUnit": "µm", "PhysicalSizeZ": 500.0, "PhysicalSizeZUnit": "nm",
    "Channel": {"Name": ["DAPI", "GFP"]}})
check("ome_channels.ome.tif", stack)
for c, field in enumerate(["DAPI", "GFP"]):
    expect("ome_channels.ome.tif", stack[c], (0.2, 0.25, 0.5), 0, field)

# OME: times, and colours that count as channels.
stack = values("u1", 2, 3, 6, 5, 3)  # T Z Y X S
tifffile.imwrite("ome_rgb_times.ome.tif", stack, ome=True, photometric="rgb", bigtiff=True,
                 metadata={"axes": "TZYXS", "TimeIncrement": 2.0})
check("ome_rgb_times.ome.tif", stack)
for t in range(2):
    expect("ome_rgb_times.ome.tif", stack[t], (1, 1, 1), t)

# Without a description of slices: byte orders, compressions, predictors, strips and tiles, types.
plain = {"photometric": "minisblack", "metadata": None}
for name, code, shape, options in [
    ("big_strips.tif", ">u2", (4, 9, 6), {"byteorder": ">", "rowsperstrip": 2}),
    ("big_lzw_differences.tif", ">i4", (3, 9, 6), {"byteorder": ">", "compression": "lzw", "predictor": 2, "rowsperstrip": 4}),
    ("tiles_lzw.tif", "<f4", (2, 20, 37), {"bigtiff": True, "tile": (16, 16), "compression": "lzw", "predictor": 3}),
    ("tiles_deflate.tif", "<f4", (2, 37, 20), {"bigtiff": True, "tile": (16, 32), "compression": "zlib", "predictor": 3}),
    ("tiles_big_deflate.tif", ">u2", (2, 37, 20), {"byteorder": ">", "tile": (16, 16), "compression": "zlib", "predictor": 2}),
    ("tiles_plain.tif", "<u1", (3, 20, 20), {"tile": (16, 16)}),
    ("packbits.tif", "<i1", (3, 8, 9), {"compression": "packbits"}),
    ("doubles.tif", "<f8", (3, 4, 5), {"compression": "lzw", "predictor": 3}),
    ("halves.tif", "<f2", (3, 4, 5), {}),
    ("halves_deflate.tif", "<f2", (3, 4, 5), {"compression": "zlib", "predictor": 3}),
    ("longs.tif", "<i8", (3, 4, 5), {"bigtiff": True}),
    ("longs_deflate.tif", ">u8", (3, 4, 5), {"byteorder": ">", "compression": "zlib", "predictor": 2}),
    ("words.tif", "<u4", (3, 4, 5), {"byteorder": "<", "compression": "zlib"}),
    ("signed.tif", "<i2", (3, 4, 5), {}),
]:
    array = values(code, *shape)
    tifffile.imwrite(name, array, **plain, **options)
    check(name, array)
    expect(name, array)

# White is zero: numbers as they are stored.
array = values("u1", 3, 4, 5)
tifffile.imwrite("white_is_zero.tif", array, photometric="miniswhite", metadata=None, compression="lzw")
check("white_is_zero.tif", array)
expect("white_is_zero.tif", array)

# Colours in planes of their own, and a fourth sample; the former in tiles.
array = values("<u2", 2, 3, 20, 18)  # Z S Y X
tifffile.imwrite("planes.tif", array, photometric="rgb", planarconfig="separate", metadata=None,
                 tile=(16, 16), compression="zlib", predictor=2)
check("planes.tif", array)
expect("planes.tif", np.moveaxis(array, 1, -1))
array = values("u1", 3, 4, 5, 4)
tifffile.imwrite("rgba.tif", array, photometric="rgb", extrasamples=["unassalpha"], metadata=None,
                 compression="lzw", predictor=2)
check("rgba.tif", array)
expect("rgba.tif", array)

# Smaller copies between the pages.
array = values("u1", 3, 8, 8)
with tifffile.TiffWriter("thumbnails.tif") as writer:
    for page in array:
        writer.write(page, contiguous=False, **plain)
        writer.write(np.ascontiguousarray(page[::2, ::2]), contiguous=False, subfiletype=1, **plain)
expect("thumbnails.tif", array)

# One page a file: together the big-endian stack, the second file compressed.
with tifffile.TiffFile("big_strips.tif") as file:
    for i, page in enumerate(file.asarray()):
        options = {"compression": "lzw"} if i == 1 else {"byteorder": ">"}
        tifffile.imwrite(f"slice_{i}.tif", page, **plain, **options)

# What must be refused.
with tifffile.TiffWriter("other_size.tif") as writer:
    for shape in [(5, 6), (5, 6), (6, 5)]:
        writer.write(values("u1", *shape), contiguous=False, **plain)
tifffile.imwrite("flat.tif", values("u1", 5, 6), **plain)
tifffile.imwrite("zstd.tif", values("u1", 3, 5, 6), compression="zstd", **plain)
tifffile.imwrite("bits.tif", values("u1", 3, 5, 8) > 40, **plain)
stack = values("u1", 4, 5, 6)
tifffile.imwrite("imagej_frames.tif", stack, imagej=True, metadata={"axes": "TYX"})
with open("expected.tsv", "w") as out:
    out.write("\n".join(lines) + "\n")
