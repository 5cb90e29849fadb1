"""Zarr arrays, groups and OME-Zarr images as zarr-python writes them, and what numbers they hold.

Made with: python -m venv v && v/bin/pip install zarr==3.1.6 numcodecs==0.16.6 numpy && v/bin/python make.py

expected.tsv: path, type, components, points along x, y, z, origin and spacing along x, y, z, name of the first field,
number of fields, number of steps, sum of the first field's numbers and sum of number × (1 + index in memory mod 97).
"""

import json
import pathlib
import shutil

import numcodecs
import numpy as np
import zarr
from zarr.codecs import (
    BloscCodec,
    BytesCodec,
    Crc32cCodec,
    GzipCodec,
    ShardingCodec,
    TransposeCodec,
    ZstdCodec,
)

HERE = pathlib.Path(__file__).parent
SHAPE = (7, 10, 13)
CHUNKS = (4, 5, 6)
expected = []


def numbers(dtype, shape=SHAPE):
    """Smooth in places and random in others, so that codecs copy, match and give up."""
    n = int(np.prod(shape))
    rng = np.random.default_rng(7)
    values = (np.arange(n) // 3) % 251 + np.where(np.arange(n) % 40 < 12, rng.integers(0, 100, n), 0)
    if np.dtype(dtype).kind == "f":
        return (values / 8 - 9).astype(dtype).reshape(shape)
    if np.dtype(dtype) == bool:
        return (values % 2 == 1).reshape(shape)
    return values.astype(dtype).reshape(shape)


def expect(path, values, components=1, origin=(0, 0, 0), spacing=(1, 1, 1), name="scalars", fields=1, steps=1):
    """`values` in the order (z, y, x[, c])."""
    read = values.astype({"bool": "u1", "float16": "f4"}.get(values.dtype.name, values.dtype))
    kind = read.dtype.newbyteorder("=").str[1:]
    kind = {"u1": "u8", "i1": "i8", "u2": "u16", "i2": "i16", "u4": "u32", "i4": "i32", "u8": "u64", "i8": "i64",
            "f4": "f32", "f8": "f64"}[kind] if read.dtype.itemsize > 1 else {"u": "u8", "i": "i8"}[read.dtype.kind]
    flat = read.astype("f8").reshape(-1)
    weights = 1 + np.arange(flat.size) % 97
    nz, ny, nx = values.shape[:3]
    row = [path, kind, components, nx, ny, nz, *origin, *spacing, name, fields, steps, flat.sum(), (flat * weights).sum()]
    expected.append("\t".join(str(v) for v in row))


def v2(name, values, chunks=CHUNKS, **options):
    array = zarr.create_array(HERE / name, shape=values.shape, chunks=chunks, dtype=values.dtype, zarr_format=2,
                              overwrite=True, **options)
    array[...] = values
    return array


def v3(name, values, chunks=CHUNKS, **options):
    array = zarr.create_array(HERE / name, shape=values.shape, chunks=chunks, dtype=values.dtype, zarr_format=3,
                              overwrite=True, **options)
    array[...] = values
    return array


for old in HERE.iterdir():
    if old.is_dir():
        shutil.rmtree(old)

# Types, and what is not stored.
for dtype in ["bool", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"]:
    values = numbers(dtype)
    v3(f"types/{dtype}.zarr", values, chunks=(4, 10, 13))
    expect(f"types/{dtype}.zarr", values)
for dtype in [">u2", ">f4", ">f8"]:
    values = numbers(dtype)
    v2(f"types/big_{dtype[1:]}.zarr", values, chunks=(4, 10, 13), compressors=None)
    expect(f"types/big_{dtype[1:]}.zarr", values)

# Codecs of version 2.
for name, codec in {
    "gzip": numcodecs.GZip(),
    "zlib": numcodecs.Zlib(),
    "bz2": numcodecs.BZ2(),
    "lzma": numcodecs.LZMA(),
    "lz4": numcodecs.LZ4(),
    "zstd": numcodecs.Zstd(),
}.items():
    values = numbers("u2")
    v2(f"v2/{name}.zarr", values, chunks=(4, 10, 13), compressors=codec)
    expect(f"v2/{name}.zarr", values)
for inner in ["blosclz", "lz4", "lz4hc", "zlib", "zstd"]:
    for shuffle in [0, 1, 2]:
        # Also in small blocks: several in a chunk, the last one shorter.
        for dtype, block in [("u2", 0), ("f4", 1024), ("u1", 96)]:
            values = numbers(dtype, (16, 18, 20))
            name = f"blosc/{inner}_{shuffle}_{dtype}.zarr"
            v2(name, values, chunks=(16, 18, 20), compressors=numcodecs.Blosc(inner, 9, shuffle, block))
            expect(name, values)
noise = np.random.default_rng(3).integers(0, 65536, (8, 9, 10)).astype("u2")
v2("blosc/noise.zarr", noise, chunks=(8, 9, 10), compressors=numcodecs.Blosc("lz4", 5, 0))
expect("blosc/noise.zarr", noise)
far = np.tile(np.random.default_rng(5).integers(0, 256, 12000).astype("u1"), 4)[:40000].reshape(20, 40, 50)
v2("blosc/far.zarr", far, chunks=(20, 40, 50), compressors=numcodecs.Blosc("blosclz", 9, 0, 40000))
expect("blosc/far.zarr", far)

# Layouts of version 2.
values = numbers("u2")
v2("v2/fortran.zarr", values, order="F")
expect("v2/fortran.zarr", values)
array = zarr.create_array(HERE / "v2/slashes.zarr", shape=SHAPE, chunks=CHUNKS, dtype="u2", zarr_format=2,
                          chunk_key_encoding={"name": "v2", "separator": "/"}, overwrite=True)
array[...] = values
expect("v2/slashes.zarr", values)

# Codecs and layouts of version 3.
v3("v3/gzip_crc.zarr", values, compressors=[GzipCodec(), Crc32cCodec()])
expect("v3/gzip_crc.zarr", values)
v3("v3/blosc.zarr", values, compressors=BloscCodec(typesize=2, cname="zstd", shuffle="bitshuffle"))
expect("v3/blosc.zarr", values)
v3("v3/big_transposed.zarr", values, filters=TransposeCodec(order=(2, 0, 1)), serializer=BytesCodec(endian="big"),
   compressors=None)
expect("v3/big_transposed.zarr", values)
v3("v3/shards.zarr", values, chunks=(2, 5, 3), shards=(4, 10, 6))
expect("v3/shards.zarr", values)
array = zarr.create_array(
    HERE / "v3/shards_first.zarr", shape=SHAPE, chunks=(4, 10, 12), dtype="u2", zarr_format=3, overwrite=True,
    serializer=ShardingCodec(chunk_shape=(2, 5, 4), codecs=[BytesCodec(endian="big"), ZstdCodec()],
                             index_codecs=[BytesCodec(endian="big")], index_location="start"),
    compressors=None)
array[...] = values
expect("v3/shards_first.zarr", values)

# What is not stored: chunks, and chunks of shards.
holes = numbers("f4")
holes[:4] = -3.5
holes[:, :, 6:12] = -3.5
for name, options in {
    "v3/holes.zarr": {},
    "v3/holes_in_shards.zarr": {"shards": (8, 10, 18)},
}.items():
    array = zarr.create_array(HERE / name, shape=SHAPE, chunks=CHUNKS, dtype="f4", zarr_format=3, fill_value=-3.5,
                              config={"write_empty_chunks": False}, overwrite=True, **options)
    array[...] = holes
    expect(name, holes)
nan = numbers("f4")
nan[:4] = np.nan
array = zarr.create_array(HERE / "v3/nan.zarr", shape=SHAPE, chunks=CHUNKS, dtype="f4", zarr_format=3, fill_value=np.nan,
                          config={"write_empty_chunks": False}, overwrite=True)
array[...] = nan

# Axes.
rgb = numbers("u1", (5, 6, 7, 3))
v3("axes/components.zarr", rgb, chunks=(3, 4, 4, 2))
expect("axes/components.zarr", rgb, components=3)
leading = numbers("u2", (1, 1, 5, 6, 7))
v3("axes/leading.zarr", leading, chunks=(1, 1, 3, 4, 4))
expect("axes/leading.zarr", leading[0, 0])
turned = numbers("u2", (5, 6, 7))
v3("axes/xyz.zarr", turned, chunks=(3, 4, 4), dimension_names=["x", "y", "z"])
expect("axes/xyz.zarr", np.ascontiguousarray(turned.transpose(2, 1, 0)))
timed = numbers("f4", (4, 5, 6, 7))
v3("axes/time.zarr", timed, chunks=(2, 3, 4, 4), dimension_names=["time", "level", "lat", "lon"])
expect("axes/time.zarr", timed[0], steps=4)

# A group of arrays, as xarray has it.
group = zarr.create_group(HERE / "group.zarr", zarr_format=2, overwrite=True)
for i, name in enumerate(["pressure", "temperature"]):
    values = numbers("f4", (4, 5, 6)) + i
    array = group.create_array(name, shape=values.shape, chunks=(2, 5, 6), dtype="f4")
    array.attrs["_ARRAY_DIMENSIONS"] = ["z", "y", "x"]
    array[...] = values
    if i == 0:
        expect("group.zarr", values, name="pressure", fields=2)
line = group.create_array("x", shape=(6,), chunks=(6,), dtype="f8")
line.attrs["_ARRAY_DIMENSIONS"] = ["x"]
line[...] = np.arange(6)


def image(name, version):
    zarr_format = 2 if version == "0.4" else 3
    group = zarr.create_group(HERE / name, zarr_format=zarr_format, overwrite=True)
    axes = [
        {"name": "t", "type": "time", "unit": "second"},
        {"name": "c", "type": "channel"},
        {"name": "z", "type": "space", "unit": "micrometer"},
        {"name": "y", "type": "space", "unit": "nanometer"},
        {"name": "x", "type": "space", "unit": "nanometer"},
    ]
    values = numbers("u2", (3, 2, 6, 8, 10))
    levels = []
    for level, part in enumerate([values, values[:, :, ::2, ::2, ::2]]):
        array = group.create_array(str(level), shape=part.shape, chunks=(1, 2, 4, 8, 8), dtype="u2",
                                   chunk_key_encoding={"name": "v2" if zarr_format == 2 else "default", "separator": "/"})
        array[...] = part
        f = 2.0**level
        steps = [{"type": "scale", "scale": [1, 1, 0.5 * f, 260 * f, 130 * f]},
                 {"type": "translation", "translation": [0, 0, 0.25 * f, 0, 65 * f]}]
        levels.append({"path": str(level), "coordinateTransformations": steps})
    multiscales = [{"version": version, "axes": axes, "datasets": levels,
                    "coordinateTransformations": [{"type": "scale", "scale": [0.1, 1, 2, 1, 1]}]}]
    omero = {"channels": [{"label": "DAPI"}, {"label": "GFP"}]}
    if zarr_format == 2:
        group.attrs.update({"multiscales": multiscales, "omero": omero})
    else:
        group.attrs["ome"] = {"version": version, "multiscales": multiscales, "omero": omero}
    # Along z in micrometres, the others in nanometres: in the unit of x.
    expect(name, values[0, 0], origin=(65, 0, 500), spacing=(130, 260, 1000), name="DAPI", fields=2, steps=3)
    expect(name + "/1", values[0, 0, ::2, ::2, ::2], origin=(130, 0, 1000), spacing=(260, 520, 2000), name="DAPI",
           fields=2, steps=3)


image("image_0.4.zarr", "0.4")
image("image_0.5.zarr", "0.5")
series = zarr.create_group(HERE / "series.zarr", zarr_format=2, overwrite=True)
series.attrs["bioformats2raw.layout"] = 3
shutil.copytree(HERE / "image_0.4.zarr", HERE / "series.zarr/0")
values = numbers("u2", (3, 2, 6, 8, 10))
expect("series.zarr", values[0, 0], origin=(65, 0, 500), spacing=(130, 260, 1000), name="DAPI", fields=2, steps=3)

(HERE / "expected.tsv").write_text("\n".join(expected) + "\n")
