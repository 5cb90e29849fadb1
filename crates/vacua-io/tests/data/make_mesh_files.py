#!/usr/bin/env python3
"""Meshes of every cell type in every encoding that VTK writes, and what VTK reads from them.

Run with VTK 9.7 and NumPy in this folder:  python3 make_mesh_files.py
Writes mesh/*.vtu *.pvtu *.vtk and mesh/expected.txt.
"""
import itertools
import os

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

OUT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "mesh")
NAMES = {10: "tetrahedron", 12: "hexahedron", 13: "wedge", 14: "pyramid", 9: "quad", 5: "triangle",
         3: "line", 1: "vertex"}
MESH = (10, 12, 13, 14)


def lattice(n, rng, jitter=0.1):
    axes = np.arange(n + 1)
    z, y, x = np.meshgrid(axes, axes, axes, indexing="ij")
    points = np.stack([x, y, z], -1).reshape(-1, 3).astype(float)
    return points + rng.uniform(-jitter, jitter, points.shape)


def corners(n, i, j, k):
    at = lambda x, y, z: x + (n + 1) * (y + (n + 1) * z)
    return [at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k),
            at(i, j, k + 1), at(i + 1, j, k + 1), at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)]


def add_arrays(grid, rng):
    points, cells = grid.GetNumberOfPoints(), grid.GetNumberOfCells()
    def add(data, values, name):
        array = numpy_to_vtk(values, deep=1)
        array.SetName(name)
        data.AddArray(array)
    xyz = vtk_to_numpy(grid.GetPoints().GetData())
    add(grid.GetPointData(), np.sin(xyz[:, 0]) + xyz[:, 1] * xyz[:, 2], "wave")
    add(grid.GetPointData(), rng.normal(size=(points, 3)).astype(np.float32), "arrow")
    add(grid.GetCellData(), np.arange(cells, dtype=np.int32) * 3 - 5, "number")
    add(grid.GetCellData(), rng.integers(0, 256, cells).astype(np.uint8), "byte")


def mixed(seed=1, low=True, dtype=np.float32):
    """Hexahedra, wedges, pyramids, tetrahedra, and cells below three dimensions among them."""
    rng = np.random.default_rng(seed)
    n = 2
    grid = vtk.vtkUnstructuredGrid()
    points = vtk.vtkPoints()
    points.SetData(numpy_to_vtk(lattice(n, rng).astype(dtype), deep=1))
    grid.SetPoints(points)
    for number, (k, j, i) in enumerate(itertools.product(range(n), repeat=3)):
        c = corners(n, i, j, k)
        pick = lambda ids: [c[a] for a in ids]
        if number % 4 == 0:
            grid.InsertNextCell(vtk.VTK_HEXAHEDRON, 8, c)
        elif number % 4 == 1:
            grid.InsertNextCell(vtk.VTK_WEDGE, 6, pick([0, 1, 3, 4, 5, 7]))
            grid.InsertNextCell(vtk.VTK_WEDGE, 6, pick([1, 2, 3, 5, 6, 7]))
        elif number % 4 == 2:
            grid.InsertNextCell(vtk.VTK_PYRAMID, 5, pick([0, 1, 2, 3, 4]))
            grid.InsertNextCell(vtk.VTK_TETRA, 4, pick([1, 2, 6, 4]))
        else:
            for t in ([0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6]):
                grid.InsertNextCell(vtk.VTK_TETRA, 4, pick(t))
        if low and number % 3 == 0:
            grid.InsertNextCell(vtk.VTK_QUAD, 4, pick([0, 1, 2, 3]))
            grid.InsertNextCell(vtk.VTK_TRIANGLE, 3, pick([0, 1, 2]))
        if low and number == 5:
            grid.InsertNextCell(vtk.VTK_LINE, 2, pick([0, 1]))
            grid.InsertNextCell(vtk.VTK_VERTEX, 1, pick([0]))
    add_arrays(grid, rng)
    return grid


def tets(dtype=np.float64):
    rng = np.random.default_rng(7)
    n = 2
    grid = vtk.vtkUnstructuredGrid()
    points = vtk.vtkPoints()
    points.SetData(numpy_to_vtk(lattice(n, rng).astype(dtype), deep=1))
    grid.SetPoints(points)
    for k, j, i in itertools.product(range(n), repeat=3):
        c = corners(n, i, j, k)
        for t in ([0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]):
            grid.InsertNextCell(vtk.VTK_TETRA, 4, [c[a] for a in t])
    add_arrays(grid, rng)
    return grid


def zoo():
    """One cell of each kind that is changed on the way in, each in a place of its own."""
    rng = np.random.default_rng(3)
    grid = vtk.vtkUnstructuredGrid()
    points = vtk.vtkPoints()
    points.SetDataTypeToDouble()
    grid.SetPoints(points)
    kinds = [vtk.vtkVoxel, vtk.vtkPentagonalPrism, vtk.vtkHexagonalPrism, vtk.vtkQuadraticTetra,
             vtk.vtkQuadraticHexahedron, vtk.vtkQuadraticWedge, vtk.vtkQuadraticPyramid,
             vtk.vtkTriQuadraticHexahedron, vtk.vtkQuadraticLinearWedge,
             vtk.vtkBiQuadraticQuadraticWedge, vtk.vtkBiQuadraticQuadraticHexahedron]
    for place, kind in enumerate(kinds):
        cell = kind()
        coords = cell.GetParametricCoords()
        n = cell.GetNumberOfPoints()
        ids = []
        for i in range(n):
            # Straight: midpoints of straight edges, so that corners say everything.
            p = [coords[3 * i] + 2 * place, coords[3 * i + 1], coords[3 * i + 2]]
            ids.append(points.InsertNextPoint(p))
        grid.InsertNextCell(cell.GetCellType(), n, ids)
    place = len(kinds)
    ids = [points.InsertNextPoint(np.array(p) + [2 * place, 0, 0])
           for p in itertools.product([0.0, 1.0], repeat=3)]
    ids.append(points.InsertNextPoint([2 * place + 0.4, 0.5, 0.6]))
    ids.append(points.InsertNextPoint([2 * place + 0.5, 0.5, 1.7]))
    grid.InsertNextCell(vtk.VTK_CONVEX_POINT_SET, len(ids), ids)
    for place in (place + 1, place + 2):
        ids = [points.InsertNextPoint(np.array(p) + [2 * place, 0, 0])
               for p in itertools.product([0.0, 1.0], repeat=3)]
        faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        stream = vtk.vtkIdList()
        stream.InsertNextId(len(faces))
        for face in faces:
            stream.InsertNextId(len(face))
            for a in face:
                stream.InsertNextId(ids[a])
        grid.InsertNextCell(vtk.VTK_POLYHEDRON, stream)
    n = points.GetNumberOfPoints()
    xyz = vtk_to_numpy(points.GetData())
    line = numpy_to_vtk(1 + 2 * xyz[:, 0] - 3 * xyz[:, 1] + 0.5 * xyz[:, 2], deep=1)
    line.SetName("line")
    grid.GetPointData().AddArray(line)
    number = numpy_to_vtk(np.arange(grid.GetNumberOfCells(), dtype=np.int16), deep=1)
    number.SetName("number")
    grid.GetCellData().AddArray(number)
    return grid


def hidden():
    grid = mixed(seed=4, low=False)
    flags = vtk.vtkUnsignedCharArray()
    flags.SetName("vtkGhostType")
    flags.SetNumberOfValues(grid.GetNumberOfCells())
    flags.Fill(0)
    flags.SetValue(2, 32)
    flags.SetValue(5, 1)
    grid.GetCellData().AddArray(flags)
    flags = vtk.vtkUnsignedCharArray()
    flags.SetName("vtkGhostType")
    flags.SetNumberOfValues(grid.GetNumberOfPoints())
    flags.Fill(0)
    flags.SetValue(26, 2)
    grid.GetPointData().AddArray(flags)
    return grid


def write_xml(grid, name, mode="appended", compressor="zlib", bits=64, order="little", base64=False):
    writer = vtk.vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetFileName(os.path.join(OUT, name))
    {"ascii": writer.SetDataModeToAscii, "inline": writer.SetDataModeToBinary,
     "appended": writer.SetDataModeToAppended}[mode]()
    writer.SetEncodeAppendedData(base64)
    writer.SetCompressor({"none": lambda: None, "zlib": vtk.vtkZLibDataCompressor,
                          "lz4": vtk.vtkLZ4DataCompressor, "lzma": vtk.vtkLZMADataCompressor}[compressor]())
    writer.SetHeaderType({32: vtk.vtkXMLWriter.UInt32, 64: vtk.vtkXMLWriter.UInt64}[bits])
    writer.SetByteOrder({"little": vtk.vtkXMLWriter.LittleEndian, "big": vtk.vtkXMLWriter.BigEndian}[order])
    writer.SetBlockSize(512)
    writer.Write()
    return name


def write_legacy(grid, name, binary, version):
    writer = vtk.vtkUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetFileName(os.path.join(OUT, name))
    writer.SetFileVersion(version)
    writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
    writer.Write()
    return name


def read_legacy(name):
    reader = vtk.vtkUnstructuredGridReader()
    reader.SetFileName(os.path.join(OUT, name))
    for every in (reader.ReadAllScalarsOn, reader.ReadAllVectorsOn, reader.ReadAllFieldsOn):
        every()
    reader.Update()
    return reader.GetOutput()


def write_parallel(grid, name, pieces):
    """Pieces of equal size, each with its own points and copies of three cells of the next one."""
    total = grid.GetNumberOfCells()
    stem = name.split(".")[0]
    files = []
    for piece in range(pieces):
        own = range(total * piece // pieces, total * (piece + 1) // pieces)
        cells = list(own) + [(own[-1] + 1 + i) % total for i in range(3)]
        # Copies come in the middle, since extraction keeps the order of the whole.
        extract = vtk.vtkExtractCells()
        extract.SetInputData(grid)
        ids = vtk.vtkIdList()
        for cell in cells:
            ids.InsertNextId(cell)
        extract.SetCellList(ids)
        extract.Update()
        part = extract.GetOutput()
        for data in (part.GetPointData(), part.GetCellData()):
            data.RemoveArray("vtkOriginalPointIds")
            data.RemoveArray("vtkOriginalCellIds")
        numbers = vtk_to_numpy(part.GetCellData().GetArray("number"))
        flags = numpy_to_vtk(((numbers + 5) // 3 < own[0]).astype(np.uint8)
                             | ((numbers + 5) // 3 > own[-1]).astype(np.uint8), deep=1)
        flags.SetName("vtkGhostType")
        part.GetCellData().AddArray(flags)
        files.append(write_xml(part, f"{stem}_{piece}.vtu"))
    with open(os.path.join(OUT, name), "w") as to:
        to.write('<VTKFile type="PUnstructuredGrid" version="1.0" byte_order="LittleEndian">\n')
        to.write('  <PUnstructuredGrid GhostLevel="1">\n')
        to.write("    <PPoints><PDataArray type=\"Float64\" NumberOfComponents=\"3\"/></PPoints>\n")
        for file in files:
            to.write(f'    <Piece Source="{file}"/>\n')
        to.write("  </PUnstructuredGrid>\n</VTKFile>\n")


def text(values):
    return " ".join(repr(v) for v in values.tolist())


def expected(to, grid, files):
    """What is expected of files that hold a mesh whose cells stay as they are."""
    to.write("contents\n")
    xyz = vtk_to_numpy(grid.GetPoints().GetData())
    to.write(f"positions {text(xyz.astype(float).ravel())}\n")
    kept = []
    for cell in range(grid.GetNumberOfCells()):
        kind = grid.GetCellType(cell)
        ids = grid.GetCell(cell).GetPointIds()
        ids = [ids.GetId(i) for i in range(ids.GetNumberOfIds())]
        if kind in MESH:
            kept.append(cell)
            to.write(f"cell {NAMES[kind]} {' '.join(map(str, ids))}\n")
        else:
            to.write(f"left_out {NAMES[kind]}\n")
    for association, data in (("point", grid.GetPointData()), ("cell", grid.GetCellData())):
        for i in range(data.GetNumberOfArrays()):
            array = data.GetArray(i)
            if array.GetName() == "vtkGhostType":
                continue
            values = vtk_to_numpy(array)
            if association == "cell":
                values = values[kept]
            kind = {"f": "f", "i": "i", "u": "u"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
            to.write(f"field {association} {kind} {array.GetNumberOfComponents()} {array.GetName()}\n")
            to.write(f"values {text(values.ravel())}\n")
    for name in files:
        to.write(f"file {name}\n")


def main():
    os.makedirs(OUT, exist_ok=True)
    with open(os.path.join(OUT, "expected.txt"), "w") as to:
        grid = mixed()
        files = [write_xml(grid, "mixed_ascii.vtu", mode="ascii")]
        for compressor, bits, order in [("none", 32, "little"), ("none", 64, "big"), ("zlib", 32, "big"),
                                        ("zlib", 64, "little"), ("lz4", 64, "little"), ("lzma", 32, "little")]:
            tag = f"{compressor}_{bits}_{order}"
            files.append(write_xml(grid, f"mixed_inline_{tag}.vtu", "inline", compressor, bits, order))
            files.append(write_xml(grid, f"mixed_raw_{tag}.vtu", "appended", compressor, bits, order))
            files.append(write_xml(grid, f"mixed_base64_{tag}.vtu", "appended", compressor, bits, order, True))
        for version in (42, 51):
            files.append(write_legacy(grid, f"mixed_binary_{version}.vtk", True, version))
        expected(to, grid, files)
        # Legacy text is rounded to six digits: what VTK reads from it is expected.
        files = [write_legacy(grid, f"mixed_ascii_{v}.vtk", False, v) for v in (42, 51)]
        expected(to, read_legacy(files[0]), files)
        grid = tets()
        files = [write_xml(grid, "tets_raw.vtu", compressor="none"), write_xml(grid, "tets_zlib.vtu"),
                 write_legacy(grid, "tets_binary_42.vtk", True, 42),
                 write_legacy(grid, "tets_binary_51.vtk", True, 51)]
        expected(to, grid, files)
    grid = zoo()
    write_xml(grid, "zoo.vtu")
    write_legacy(grid, "zoo_51.vtk", True, 51)
    write_legacy(grid, "zoo_42.vtk", False, 42)
    write_xml(hidden(), "hidden.vtu", mode="ascii")
    write_legacy(hidden(), "hidden.vtk", True, 51)
    write_parallel(tets(), "pieces.pvtu", 3)


if __name__ == "__main__":
    main()
