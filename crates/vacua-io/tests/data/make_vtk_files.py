"""Writes the small VTK files of this folder with VTK itself, and what VTK reads from them.

    pip install vtk && python make_vtk_files.py

Files go to vtk/; vtk/expected.txt describes what VTK's own readers find in each:

    contents            begins a description
    kind uniform        uniform, rectilinear or curvilinear
    dimensions 5 4 3    points a side
    positions x y z …   of all points, x fastest
    field point f32 3 a name with spaces
    values v v v …      tuple after tuple
    blanked 3 7         cells that are hidden, or whose points are
    file name …         every file with these contents
"""

import itertools
import pathlib
import sys

import numpy as np
import vtk
import vtk.util.vtkAlgorithm
from vtk.util import numpy_support

HERE = pathlib.Path(__file__).parent
OUT = HERE / "vtk"
EXTENT = (2, 6, -1, 2, 0, 2)
DIMENSIONS = (5, 4, 3)
NUM_POINTS, NUM_CELLS = 60, 24
TYPES = {
    "int8": "i8", "uint8": "u8", "int16": "i16", "uint16": "u16", "int32": "i32",
    "uint32": "u32", "int64": "i64", "uint64": "u64", "float32": "f32", "float64": "f64",
}


def array(values, name, components=1):
    values = np.ascontiguousarray(values)
    if components > 1:
        values = values.reshape(-1, components)
    result = numpy_support.numpy_to_vtk(values, deep=1)
    if name is not None:
        result.SetName(name)
    return result


def index_points(extent=EXTENT):
    x0, x1, y0, y1, z0, z1 = extent
    return [(i, j, k) for k in range(z0, z1 + 1) for j in range(y0, y1 + 1) for i in range(x0, x1 + 1)]


def grid(kind, extent=EXTENT, points_dtype=np.float32):
    if kind == "vti":
        result = vtk.vtkImageData()
        result.SetExtent(extent)
        result.SetOrigin(10.0, -2.5, 0.25)
        result.SetSpacing(0.5, 2.0, 0.125)
    elif kind == "vtr":
        result = vtk.vtkRectilinearGrid()
        result.SetExtent(extent)
        axes = [np.arange(a, b + 1, dtype=np.float64) for a, b in zip(extent[::2], extent[1::2])]
        result.SetXCoordinates(array(axes[0] * axes[0] * 0.1, "x"))
        result.SetYCoordinates(array((axes[1] * 0.7).astype(np.float32), "y"))
        result.SetZCoordinates(array((axes[2] * axes[2] * 3 - 5).astype(np.int32), "z"))
    else:
        result = vtk.vtkStructuredGrid()
        result.SetExtent(extent)
        ijk = np.array(index_points(extent), dtype=np.float64)
        angle, radius = ijk[:, 0] * 0.2, 2 + ijk[:, 1] * 0.5
        xyz = np.stack([radius * np.cos(angle), radius * np.sin(angle), ijk[:, 2] + 0.1 * angle], 1)
        xyz = np.round(xyz * 64) / 64
        points = vtk.vtkPoints()
        points.SetData(array(xyz.astype(points_dtype).ravel(), "Points", 3))
        result.SetPoints(points)
    return result


def plain(kind, extent=EXTENT):
    result = grid(kind, extent)
    ijk = np.array(index_points(extent), dtype=np.int64)
    hashed = (ijk[:, 0] * 7919 + ijk[:, 1] * 104729 + ijk[:, 2] * 1299709) % 1000
    point = result.GetPointData()
    point.AddArray(array(np.sin(hashed).astype(np.float32), "temperature"))
    vector = np.stack([hashed, -hashed, ijk[:, 0]], 1).astype(np.int16)
    point.AddArray(array(vector, "flow (m³ per s)", 3))
    cells = index_points([b - (n % 2) for n, b in enumerate(extent)])
    ids = np.array([i + 100 * j + 10000 * k for i, j, k in cells], dtype=np.int32)
    result.GetCellData().AddArray(array(ids, "id"))
    return result


def all_types(kind):
    result = grid(kind, points_dtype=np.float64)
    rng = np.random.default_rng(1)
    for dtype in TYPES:
        if dtype.startswith("f"):
            values = (rng.standard_normal(NUM_POINTS) * 1e5).astype(dtype)
            values[:3] = [np.finfo(dtype).max / 4, np.finfo(dtype).tiny * 2, -0.0]
        else:
            info = np.iinfo(dtype)
            values = rng.integers(info.min, info.max, NUM_POINTS, dtype=dtype, endpoint=True)
            values[:2] = [info.min, info.max]
        result.GetPointData().AddArray(array(values, dtype))
    strings = vtk.vtkStringArray()
    strings.SetName("words")
    bits = vtk.vtkBitArray()
    bits.SetName("bits")
    for i in range(NUM_CELLS):
        strings.InsertNextValue("a word " * (i % 3) * (1 + 5 * (i == 5)))
        bits.InsertNextValue(i % 3 == 0)
    result.GetCellData().AddArray(strings)
    result.GetCellData().AddArray(bits)
    result.GetCellData().AddArray(array(np.arange(NUM_CELLS, dtype=np.float64) / 7, "after"))
    steps = array(np.array([1.5, 2.5]), "TimeValue")
    result.GetFieldData().AddArray(steps)
    return result


def ghosts(kind):
    result = plain(kind)
    point = np.zeros(NUM_POINTS, dtype=np.uint8)
    point[0], point[59], point[7] = 2, 3, 1
    cell = np.zeros(NUM_CELLS, dtype=np.uint8)
    cell[5], cell[6], cell[20] = 32, 1, 33
    result.GetPointData().AddArray(array(point, "vtkGhostType"))
    result.GetCellData().AddArray(array(cell, "vtkGhostType"))
    return result


def attributes(kind):
    result = grid(kind)
    rng = np.random.default_rng(2)
    numbers = lambda n: np.round(rng.standard_normal(NUM_POINTS * n), 2).astype(np.float32)
    point = result.GetPointData()
    scalars = array(rng.integers(0, 255, NUM_POINTS, dtype=np.uint8), "a scalar 100%")
    table = vtk.vtkLookupTable()
    table.SetNumberOfTableValues(6)
    table.Build()
    scalars.SetLookupTable(table)
    point.SetScalars(scalars)
    point.SetVectors(array(numbers(3), "vectors", 3))
    normals = numbers(3).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    point.SetNormals(array(normals, "normals", 3))
    point.SetTensors(array(numbers(9), "tensors", 9))
    point.SetTCoords(array(numbers(2), "tcoords", 2))
    point.SetGlobalIds(numpy_support.numpy_to_vtkIdTypeArray(np.arange(NUM_POINTS), deep=1))
    point.GetGlobalIds().SetName("ids")
    extra = array(numbers(2), "extra array", 2)
    extra.SetComponentName(0, "first part")
    extra.SetComponentName(1, "second")
    extra.GetRange(-1)
    point.AddArray(extra)
    cell = result.GetCellData()
    colours = rng.integers(0, 255, NUM_CELLS * 3, dtype=np.uint8)
    cell.SetScalars(array(colours, "colours", 3))
    cell.AddArray(array(np.arange(NUM_CELLS, dtype=np.float64) - 0.5, "more"))
    result.GetFieldData().AddArray(array(np.array([0.5]), "TIME"))
    return result


XML = {
    "vti": (vtk.vtkXMLImageDataWriter, vtk.vtkXMLImageDataReader, vtk.vtkXMLPImageDataWriter, vtk.vtkXMLPImageDataReader),
    "vtr": (vtk.vtkXMLRectilinearGridWriter, vtk.vtkXMLRectilinearGridReader, vtk.vtkXMLPRectilinearGridWriter, vtk.vtkXMLPRectilinearGridReader),
    "vts": (vtk.vtkXMLStructuredGridWriter, vtk.vtkXMLStructuredGridReader, vtk.vtkXMLPStructuredGridWriter, vtk.vtkXMLPStructuredGridReader),
}
COMPRESSORS = {
    "none": vtk.vtkXMLWriterBase.NONE, "zlib": vtk.vtkXMLWriterBase.ZLIB,
    "lz4": vtk.vtkXMLWriterBase.LZ4, "lzma": vtk.vtkXMLWriterBase.LZMA,
}
written = []


def configure(writer, encoding, compressor="none", header=64, order="little"):
    modes = {"ascii": writer.SetDataModeToAscii, "inline": writer.SetDataModeToBinary}
    modes.get(encoding, writer.SetDataModeToAppended)()
    writer.SetEncodeAppendedData(encoding == "base64")
    writer.SetCompressorType(COMPRESSORS[compressor])
    writer.SetBlockSize(112)
    writer.SetHeaderTypeToUInt32() if header == 32 else writer.SetHeaderTypeToUInt64()
    writer.SetByteOrderToBigEndian() if order == "big" else writer.SetByteOrderToLittleEndian()


def write_xml(data, kind, name, pieces=1, **how):
    writer = XML[kind][0]()
    configure(writer, **how)
    writer.SetNumberOfPieces(pieces)
    writer.SetFileName(str(OUT / f"{name}.{kind}"))
    source = WholeGrid(data)
    writer.SetInputConnection(source.GetOutputPort()) if pieces > 1 else writer.SetInputDataObject(data)
    assert writer.Write() == 1
    written.append(OUT / f"{name}.{kind}")


class WholeGrid(vtk.util.vtkAlgorithm.VTKPythonAlgorithmBase):
    """Gives any part of a grid, as parallel writers ask for it."""

    def __init__(self, data):
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType=data.GetClassName())
        self.data = data

    def RequestInformation(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        info.Set(vtk.vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT(), self.data.GetExtent(), 6)
        if hasattr(self.data, "GetSpacing"):
            info.Set(vtk.vtkDataObject.SPACING(), self.data.GetSpacing(), 3)
            info.Set(vtk.vtkDataObject.ORIGIN(), self.data.GetOrigin(), 3)
        info.Set(vtk.vtkAlgorithm.CAN_PRODUCE_SUB_EXTENT(), 1)
        return 1

    def RequestData(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        update = [0] * 6
        info.Get(vtk.vtkStreamingDemandDrivenPipeline.UPDATE_EXTENT(), update)
        output = info.Get(vtk.vtkDataObject.DATA_OBJECT())
        output.ShallowCopy(self.data)
        output.Crop(update)
        return 1


def write_parallel(data, kind, name, pieces, ghost_level):
    source = WholeGrid(data)
    writer = XML[kind][2]()
    configure(writer, "raw", "none", 32)
    writer.SetFileName(str(OUT / f"{name}.p{kind}"))
    writer.SetInputConnection(source.GetOutputPort())
    writer.SetNumberOfPieces(pieces)
    writer.SetStartPiece(0)
    writer.SetEndPiece(pieces - 1)
    writer.SetGhostLevel(ghost_level)
    assert writer.Write() == 1
    written.append(OUT / f"{name}.p{kind}")


LEGACY = {
    "vti": (vtk.vtkStructuredPointsWriter, vtk.vtkStructuredPointsReader),
    "vtr": (vtk.vtkRectilinearGridWriter, vtk.vtkRectilinearGridReader),
    "vts": (vtk.vtkStructuredGridWriter, vtk.vtkStructuredGridReader),
}


def write_legacy(data, kind, name, binary, version, write_extent=False):
    writer = LEGACY[kind][0]()
    if kind == "vti":
        points = vtk.vtkStructuredPoints()
        points.ShallowCopy(data)
        data = points
    writer.SetInputDataObject(data)
    writer.SetFileVersion(version)
    writer.SetWriteExtent(write_extent)
    writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
    writer.SetFileName(str(OUT / f"{name}.vtk"))
    assert writer.Write() == 1
    written.append(OUT / f"{name}.vtk")


OLD = """# vtk DataFile Version {version}
an old file
ASCII
DATASET STRUCTURED_POINTS
DIMENSIONS 5 4 3
{spacing} 0.5 2 0.25
ORIGIN 1 2 3
CELL_DATA 24
scalars steps short
lookup_table default
{cells}
POINT_DATA 60
COLOR_SCALARS rgb 3
{colours}
TEXTURE_COORDINATES tc 2 float
{two}
TENSORS stress double
{nine}
LOOKUP_TABLE mine 2
0 0 0 1
1 1 1 1
FIELD FieldData 2
lone 1 3 int
1 2 3
pair 2 60 float
{two}
"""


def write_old(version, spacing):
    rng = np.random.default_rng(3)
    text = OLD.format(
        version=version,
        spacing=spacing,
        cells="\n".join(str(i * 37 - 300) for i in range(24)),
        colours=" ".join(f"{v:.3f}" for v in rng.random(180)),
        two=" ".join(f"{v:.1e}" for v in rng.standard_normal(120)),
        nine=" ".join(f"{v:.1f}" for v in rng.standard_normal(540)),
    )
    name = OUT / f"old_{version.replace('.', '_')}.vtk"
    name.write_text(text)
    written.append(name)


def read(path):
    suffix = path.suffix[1:]
    if suffix == "vtk":
        reader = vtk.vtkDataSetReader()
        reader.ReadAllScalarsOn()
        reader.ReadAllVectorsOn()
        reader.ReadAllNormalsOn()
        reader.ReadAllTensorsOn()
        reader.ReadAllColorScalarsOn()
        reader.ReadAllTCoordsOn()
        reader.ReadAllFieldsOn()
    elif suffix.startswith("p"):
        reader = XML[suffix[1:]][3]()
    else:
        reader = XML[suffix][1]()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutputDataObject(0)


def number(value):
    return str(value) if isinstance(value, np.floating) else str(int(value))


def numbers(values):
    return " ".join(number(v) for v in np.asarray(values).ravel())


def hidden_cells(data):
    hidden = []
    for cell in range(data.GetNumberOfCells()):
        flags = data.GetCellGhostArray()
        hide = flags is not None and flags.GetValue(cell) & 32
        flags = data.GetPointGhostArray()
        ids = vtk.vtkIdList()
        data.GetCellPoints(cell, ids)
        corners = [ids.GetId(i) for i in range(ids.GetNumberOfIds())]
        hide = hide or (flags is not None and any(flags.GetValue(p) & 2 for p in corners))
        if hide:
            hidden.append(cell)
    return hidden


def describe(data):
    kinds = {
        "vtkImageData": "uniform", "vtkStructuredPoints": "uniform",
        "vtkRectilinearGrid": "rectilinear", "vtkStructuredGrid": "curvilinear",
    }
    lines = [f"kind {kinds[data.GetClassName()]}"]
    extent = data.GetExtent()
    sides = [b - a + 1 for a, b in zip(extent[::2], extent[1::2])]
    lines.append("dimensions " + " ".join(map(str, sides)))
    positions = [data.GetPoint(i) for i in range(data.GetNumberOfPoints())]
    lines.append("positions " + numbers(np.array(positions)))
    for association, attributes in (("point", data.GetPointData()), ("cell", data.GetCellData())):
        for index in range(attributes.GetNumberOfArrays()):
            values = attributes.GetAbstractArray(index)
            name = values.GetName()
            if values.GetClassName() in ("vtkStringArray", "vtkBitArray") or name == "vtkGhostType":
                continue
            size = data.GetNumberOfPoints() if association == "point" else data.GetNumberOfCells()
            if values.GetNumberOfTuples() != size:
                continue
            values = numpy_support.vtk_to_numpy(values)
            components = 1 if values.ndim == 1 else values.shape[1]
            lines.append(f"field {association} {TYPES[values.dtype.name]} {components} {name}")
            lines.append("values " + numbers(values))
    lines.append("blanked " + " ".join(map(str, hidden_cells(data))))
    return "\n".join(lines)


def main():
    OUT.mkdir(exist_ok=True)
    for old in OUT.iterdir():
        old.unlink()
    for kind in XML:
        data = plain(kind)
        write_xml(data, kind, "ascii", encoding="ascii")
        combinations = itertools.product(
            ("inline", "raw", "base64"), COMPRESSORS, (32, 64), ("little", "big")
        )
        if kind != "vti":
            orders = itertools.cycle([(32, "little"), (64, "big"), (64, "little"), (32, "big")])
            pairs = itertools.product(("inline", "raw", "base64"), COMPRESSORS)
            combinations = [pair + next(orders) for pair in pairs]
        for encoding, compressor, header, order in combinations:
            name = f"{encoding}_{compressor}_{header}_{order}"
            how = dict(encoding=encoding, compressor=compressor, header=header, order=order)
            write_xml(data, kind, name, **how)
        write_xml(ghosts(kind), kind, "ghosts", encoding="raw", compressor="zlib")
        write_xml(data, kind, "pieces", pieces=3, encoding="inline", compressor="lz4")
        for level in (0, 1):
            write_parallel(data, kind, f"parallel_{level}", 3 + level, level)
        for binary in (False, True):
            flavour = "binary" if binary else "ascii"
            for version in (42, 51) if kind == "vts" else (51,):
                write_legacy(attributes(kind), kind, f"legacy_{kind}_{flavour}_{version}", binary, version)
        write_legacy(ghosts(kind), kind, f"legacy_{kind}_ghosts", True, 51, write_extent=True)
    write_xml(all_types("vti"), "vti", "types_ascii", encoding="ascii")
    write_xml(all_types("vti"), "vti", "types_inline", encoding="inline")
    write_xml(all_types("vti"), "vti", "types_raw_big", encoding="raw", order="big")
    write_legacy(all_types("vti"), "vti", "legacy_types_ascii", False, 51)
    write_legacy(all_types("vti"), "vti", "legacy_types_binary", True, 51)
    turned = plain("vti")
    turned.SetDirectionMatrix(0, -1, 0, 0.6, 0, 0.8, -0.8, 0, 0.6)
    write_xml(turned, "vti", "turned", encoding="raw")
    write_old("1.0", "aspect_ratio")
    write_old("3.0", "SPACING")
    by_contents = {}
    for path in written:
        by_contents.setdefault(describe(read(path)), []).append(path.name)
    with open(OUT / "expected.txt", "w") as out:
        for contents, names in by_contents.items():
            print("contents", contents, "file " + " ".join(names), sep="\n", file=out)
    print(len(written), "files,", len(by_contents), "different contents", file=sys.stderr)


main()
