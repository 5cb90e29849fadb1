#!/usr/bin/env python3
"""XDMF files as VTK and meshio write them, and by hand what neither writes; VTK reads them all back.

Run with VTK 9.7, meshio 5.3, h5py and NumPy in this folder:  python3 make_xdmf_files.py
Writes xdmf/*.xmf, *.xdmf with their heavy data, and what VTK reads from them: xdmf/expected.txt.
"""
import os
import shutil

import h5py
import meshio
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

import make_hdf_files as hdf
import make_mesh_files as meshes

OUT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "xdmf")
TIMES = hdf.TIMES
MESHIO = {10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid", 9: "quad", 5: "triangle",
          3: "line", 1: "vertex"}


def write(data, name, light=0):
    writer = vtk.vtkXdmfWriter()
    writer.SetInputDataObject(data)
    writer.SetFileName(name)
    writer.SetLightDataLimit(light)
    writer.Write()
    return name


def read(name, step=None):
    reader = vtk.vtkXdmfReader()
    reader.SetFileName(name)
    reader.UpdateInformation()
    if step is not None:
        reader.UpdateTimeStep(TIMES[step])
    reader.Update()
    data = reader.GetOutputDataObject(0)
    while isinstance(data, vtk.vtkMultiBlockDataSet):
        data = data.GetBlock(0)
    return data


def sorted_by_kind(grid):
    """The cells of a kind together, as meshio keeps them."""
    kinds = [grid.GetCellType(cell) for cell in range(grid.GetNumberOfCells())]
    order = sorted(range(len(kinds)), key=lambda cell: kinds[cell])
    made = vtk.vtkUnstructuredGrid()
    made.SetPoints(grid.GetPoints())
    for cell in order:
        made.InsertNextCell(kinds[cell], grid.GetCell(cell).GetPointIds())
    # In f64, since meshio rounds f32 to too few digits for text.
    for i in range(grid.GetPointData().GetNumberOfArrays()):
        array = grid.GetPointData().GetArray(i)
        values = numpy_to_vtk(vtk_to_numpy(array).astype(float), deep=1)
        values.SetName(array.GetName())
        made.GetPointData().AddArray(values)
    for i in range(grid.GetCellData().GetNumberOfArrays()):
        array = grid.GetCellData().GetArray(i)
        values = numpy_to_vtk(vtk_to_numpy(array)[order], deep=1)
        values.SetName(array.GetName())
        made.GetCellData().AddArray(values)
    return made


def as_meshio(grid):
    blocks, rows = [], []
    for cell in range(grid.GetNumberOfCells()):
        kind = MESHIO[grid.GetCellType(cell)]
        ids = grid.GetCell(cell).GetPointIds()
        ids = [ids.GetId(i) for i in range(ids.GetNumberOfIds())]
        if not blocks or blocks[-1][0] != kind:
            blocks.append((kind, []))
            rows.append([])
        blocks[-1][1].append(ids)
        rows[-1].append(cell)
    arrays = lambda data: {data.GetArrayName(i): vtk_to_numpy(data.GetArray(i)) for i in range(data.GetNumberOfArrays())}
    return meshio.Mesh(
        vtk_to_numpy(grid.GetPoints().GetData()), [(kind, np.array(ids)) for kind, ids in blocks],
        point_data=arrays(grid.GetPointData()),
        cell_data={key: [values[r] for r in rows] for key, values in arrays(grid.GetCellData()).items()})


def series(grid, name):
    mesh = as_meshio(grid)
    with meshio.xdmf.TimeSeriesWriter(name) as to:
        to.write_points_cells(mesh.points, mesh.cells)
        for step, time in enumerate(TIMES):
            at = as_meshio(hdf.at_step(grid, step))
            to.write_data(time, point_data=at.point_data, cell_data=at.cell_data)
    return name


def item(values, text=None, **more):
    values = np.asarray(values)
    kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind]
    if values.dtype == np.uint8:
        kind = "UChar"
    more.setdefault("Format", "XML")
    attributes = " ".join(f'{key}="{value}"' for key, value in more.items())
    dimensions = " ".join(map(str, values.shape))
    text = " ".join(repr(v) for v in values.ravel().tolist()) if text is None else text
    return (f'<DataItem Dimensions="{dimensions}" NumberType="{kind}" Precision="{values.dtype.itemsize}" '
            f"{attributes}>{text}</DataItem>")


def document(name, grids, version="2.0"):
    with open(name, "w") as to:
        to.write(f'<?xml version="1.0"?>\n<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>\n'
                 f'<Xdmf Version="{version}" xmlns:xi="http://www.w3.org/2001/XInclude">\n'
                 f"<Domain>\n{grids}\n</Domain>\n</Xdmf>\n")
    return name


def attributes(grid, make=lambda name, values: item(values)):
    text = ""
    for center, data in (("Node", grid.GetPointData()), ("Cell", grid.GetCellData())):
        for i in range(data.GetNumberOfArrays()):
            array = data.GetArray(i)
            kind = "Vector" if array.GetNumberOfComponents() == 3 else "Scalar"
            text += (f'<Attribute Name="{array.GetName()}" Center="{center}" AttributeType="{kind}">'
                     f"{make(array.GetName(), vtk_to_numpy(array))}</Attribute>\n")
    return text


def by_hand(grid):
    """Tetrahedra with positions axis by axis, numbers in one binary file of both byte orders."""
    heavy = open("hand.bin", "wb")
    places = []

    def binary(name, values):
        order = "><"[len(places) % 2]
        place = heavy.tell()
        places.append(place)
        heavy.write(values.astype(values.dtype.newbyteorder(order)).tobytes())
        return item(values, "hand.bin", Format="Binary", Endian={">": "Big", "<": "Little"}[order], Seek=place)

    points = vtk_to_numpy(grid.GetPoints().GetData())
    cells = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 4).astype("i4")
    axes = "".join(binary("", np.ascontiguousarray(points[:, axis])) for axis in range(3))
    text = ('<Grid Name="hand" GridType="Uniform">'
            f'<Topology Type="Tetrahedron" NumberOfElements="{len(cells)}">{binary("", cells)}</Topology>'
            f'<Geometry Type="X_Y_Z">{axes}</Geometry>\n{attributes(grid, binary)}</Grid>')
    heavy.close()
    return document("hand.xmf", text)


def slabs(grid):
    """The steps as planes of one HDF5 array each, the mesh by references to the first grid."""
    with h5py.File("slabs.h5", "w") as file:
        points = vtk_to_numpy(grid.GetPoints().GetData())
        cells = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 4)
        wave = np.stack([vtk_to_numpy(hdf.at_step(grid, s).GetPointData().GetArray("wave")) for s in range(3)])
        number = np.stack([vtk_to_numpy(hdf.at_step(grid, s).GetCellData().GetArray("number")) for s in range(3)])
        file["mesh/points"], file["mesh/cells"] = points, cells + 1
        # Every other number along the last axis is the one.
        file["wave"], file["number"] = wave, np.repeat(number, 2, axis=1)
    grids = ""
    for step, time in enumerate(TIMES):
        def slab(name, whole, start, stride, count):
            select = item(np.array([start, stride, count]))
            inner = item(whole, f"slabs.h5:/{name}", Format="HDF")
            return (f'<DataItem ItemType="HyperSlab" Dimensions="{count[-1]}">{select}{inner}</DataItem>')
        mesh = (f'<Topology TopologyType="Tetrahedron" NumberOfElements="{len(cells)}" BaseOffset="1">'
                f'{item(cells, "slabs.h5:/mesh/cells", Format="HDF")}</Topology>'
                f'<Geometry GeometryType="XYZ">{item(points, "slabs.h5:/mesh/points", Format="HDF")}</Geometry>')
        if step == 1:
            mesh = ('<Topology Reference="/Xdmf/Domain/Grid/Grid[1]/Topology"/>'
                    '<Geometry Reference="XML">/Xdmf/Domain/Grid/Grid[1]/Geometry</Geometry>')
        if step == 2:
            mesh = ('<xi:include xpointer="xpointer(//Grid[@Name=&quot;first&quot;]'
                    '/*[self::Topology or self::Geometry])"/>')
        grids += (f'<Grid Name="{["first", "second", "third"][step]}">{mesh}'
                  f'<Attribute Name="wave" Center="Node">'
                  f"{slab('wave', wave, [step, 0], [1, 1], [1, wave.shape[1]])}</Attribute>"
                  f'<Attribute Name="number" Center="Cell">'
                  f"{slab('number', np.repeat(number, 2, axis=1), [step, 0], [1, 2], [1, number.shape[1]])}"
                  f"</Attribute></Grid>\n")
    times = item(np.array(TIMES))
    return document("slabs.xdmf", '<Grid GridType="Collection" CollectionType="Temporal">'
                    f'<Time TimeType="List">{times}</Time>\n{grids}</Grid>', "3.0")


def polyhedra():
    """A polyhedron and a quadratic tetrahedron between a hexahedron and a voxel's worth of points."""
    cube = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    points = np.concatenate([cube, cube + [2, 0, 0], cube[:4] * 2 + [4, 0, 0], cube[4:] + [4, 0, 2], [[5, 1, 1], [6, 1, 1]]])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    stream = [9, 0, 1, 3, 2, 4, 5, 7, 6, 16, 6]
    for face in faces:
        stream += [4] + [8 + a for a in face]
    stream += [38] + list(range(16, 26)) + [2, 3, 0, 1, 2]
    value = points[:, 0]
    return document("polyhedra.xdmf", '<Grid Name="p"><Topology TopologyType="Mixed" NumberOfElements="4">'
                    f'{item(np.array(stream))}</Topology><Geometry GeometryType="XYZ">{item(points)}</Geometry>'
                    f'<Attribute Name="x" Center="Node">{item(value)}</Attribute>'
                    f'<Attribute Name="one" Center="Grid">{item(np.array([1.0]))}</Attribute></Grid>', "3.0")


def strip(grid, names):
    made = vtk.vtkUnstructuredGrid()
    made.ShallowCopy(grid)
    for data in (made.GetPointData(), made.GetCellData()):
        for name in [data.GetArrayName(i) for i in range(data.GetNumberOfArrays())]:
            if name not in names:
                data.RemoveArray(name)
    return made


def structured(kind):
    """A rectilinear or a curvilinear grid with one array on points and one on cells."""
    nx, ny, nz = 4, 3, 5
    if kind == "rectilinear":
        grid = vtk.vtkRectilinearGrid()
        for axis, n in enumerate((nx, ny, nz)):
            [grid.SetXCoordinates, grid.SetYCoordinates, grid.SetZCoordinates][axis](
                numpy_to_vtk(np.cumsum(1.0 + np.arange(n) * (axis + 1) / 8), deep=1))
    else:
        grid = vtk.vtkStructuredGrid()
        z, y, x = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
        xyz = np.stack([x + 0.25 * y, y * 1.5, z + 0.125 * x], -1).reshape(-1, 3).astype(np.float64)
        points = vtk.vtkPoints()
        points.SetData(numpy_to_vtk(xyz, deep=1))
        grid.SetPoints(points)
    grid.SetDimensions(nx, ny, nz)
    for data, name, count in ((grid.GetPointData(), "p", nx * ny * nz),
                              (grid.GetCellData(), "c", (nx - 1) * (ny - 1) * (nz - 1))):
        values = numpy_to_vtk(np.sin(np.arange(count)), deep=1)
        values.SetName(name)
        data.AddArray(values)
    return grid


def main():
    # VTK's writer writes into HDF5 files that are there.
    shutil.rmtree(OUT, ignore_errors=True)
    os.makedirs(OUT)
    os.chdir(OUT)
    with open("expected.txt", "w") as to:
        # VTK's writer calls a quadrilateral among mixed cells a polygon and leaves its count out: none here.
        grid = meshes.mixed(low=False)
        name = write(grid, "mixed.xmf")
        meshes.expected(to, grid, [name])
        grid = meshes.mixed(dtype=float)
        name = write(meshes.tets(), "tets.xmf")
        meshes.expected(to, meshes.tets(), [name])
        # Text is rounded to six digits; VTK's reader loses the vectors of VTK's writer.
        few = strip(meshes.tets(), ["wave", "number", "byte"])
        name = write(few, "tets_text.xmf", light=100000)
        meshes.expected(to, read(name), [name])
        by_kind = strip(sorted_by_kind(grid), ["wave", "arrow", "number"])
        files = []
        for form in ("XML", "Binary", "HDF"):
            files.append(f"meshio_{form.lower()}.xdmf")
            as_meshio(by_kind).write(files[-1], data_format=form)
        meshes.expected(to, by_kind, files)
        tets = strip(meshes.tets(), ["wave", "arrow", "number"])
        name = series(tets, "meshio_series.xdmf")
        for step in range(3):
            hdf.expected(to, hdf.at_step(tets, step), [name], step)
        name = by_hand(meshes.tets())
        meshes.expected(to, read(name), [name])
        name = slabs(tets)
        few = strip(tets, ["wave", "number"])
        for step in range(3):
            hdf.expected(to, hdf.at_step(few, step), [name], step)
        image = hdf.image()
        image.SetExtent(0, 4, 0, 3, 0, 3)
        name = write(image, "image.xmf")
        hdf.expected_image(to, image, [name])
    polyhedra()
    for kind in ("rectilinear", "curvilinear"):
        grid = structured(kind)
        write(grid, f"{kind}.xmf")
        xml = vtk.vtkXMLRectilinearGridWriter() if kind == "rectilinear" else vtk.vtkXMLStructuredGridWriter()
        xml.SetFileName(f"{kind}.{'vtr' if kind == 'rectilinear' else 'vts'}")
        xml.SetInputDataObject(grid)
        xml.Write()


if __name__ == "__main__":
    main()
