#!/usr/bin/env python3
"""Writes what VTK's probe filter finds in meshes, as probe/NAME.csv, and warped.vtu.

    pip install vtk numpy && python make_mesh_probe.py

Columns as in make_probe_points.py: half of the points are random in the box around the mesh, half in
random cells. VTK stops its search for a point's place in a hexahedron, wedge or pyramid early (at
1e-3 of the cell); as there, the search goes on with VTK's own shape functions until the place is
exact. How much that changes is printed.
"""
import csv
import itertools
import pathlib

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

HERE = pathlib.Path(__file__).parent
NUM_POINTS = 300
SHAPES = {vtk.VTK_HEXAHEDRON: vtk.vtkHexahedron, vtk.VTK_WEDGE: vtk.vtkWedge, vtk.VTK_PYRAMID: vtk.vtkPyramid}
CORNERS = {vtk.VTK_TETRA: 4, vtk.VTK_PYRAMID: 5, vtk.VTK_WEDGE: 6, vtk.VTK_HEXAHEDRON: 8}


def write_warped(path):
    """All four types with faces far from plane, and a field that is far from linear."""
    n, rng = 5, np.random.default_rng(11)
    axes = np.arange(n + 1)
    z, y, x = np.meshgrid(axes, axes, axes, indexing="ij")
    xyz = np.stack([x, y, z], -1).reshape(-1, 3).astype(float)
    inner = ((xyz > 0) & (xyz < n)).all(1)
    xyz[inner] += rng.uniform(-0.22, 0.22, (inner.sum(), 3))
    points, cells = list(map(tuple, xyz)), []
    at = lambda i, j, k: i + (n + 1) * (j + (n + 1) * k)
    for k, j, i in itertools.product(range(n), repeat=3):
        c = [at(i + a, j + b, k + d) for d in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        kind = (i + 2 * j + k) % 4
        if kind == 0:
            cells.append((vtk.VTK_HEXAHEDRON, c))
        elif kind == 1:
            cells += [(vtk.VTK_WEDGE, [c[a] for a in w]) for w in ([0, 1, 3, 4, 5, 7], [1, 2, 3, 5, 6, 7])]
        elif kind == 2:
            middle = len(points)
            points.append(tuple(np.mean([points[a] for a in c], 0)))
            for f in ([0, 1, 2, 3], [7, 6, 5, 4], [0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3], [3, 7, 4, 0]):
                cells.append((vtk.VTK_PYRAMID, [c[a] for a in f] + [middle]))
        else:
            for t in ([0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]):
                cells.append((vtk.VTK_TETRA, [c[a] for a in t]))
    grid = vtk.vtkUnstructuredGrid()
    vtk_points = vtk.vtkPoints()
    xyz = np.array(points)
    vtk_points.SetData(numpy_to_vtk(xyz, deep=1))
    grid.SetPoints(vtk_points)
    for kind, ids in cells:
        grid.InsertNextCell(kind, len(ids), ids)
    wave = numpy_to_vtk(np.sin(2 * xyz[:, 0]) * np.cos(xyz[:, 1]) + 0.3 * xyz[:, 2] ** 2, deep=1)
    wave.SetName("wave")
    grid.GetPointData().AddArray(wave)
    writer = vtk.vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    writer.Write()


def read(name):
    path = str(HERE / name)
    if name.endswith(".ex2"):
        reader = vtk.vtkExodusIIReader()
        reader.SetFileName(path)
        reader.SetApplyDisplacements(False)
        reader.UpdateInformation()
        reader.SetAllArrayStatus(vtk.vtkExodusIIReader.NODAL, 1)
        reader.Update()
        return reader.GetOutput().GetBlock(0).GetBlock(0)
    reader = vtk.vtkXMLUnstructuredGridReader() if name.endswith("vtu") else vtk.vtkUnstructuredGridReader()
    reader.SetFileName(path)
    if name.endswith("vtk"):
        reader.ReadAllScalarsOn()
        reader.ReadAllTensorsOn()
        reader.ReadAllFieldsOn()
    reader.Update()
    return reader.GetOutput()


def with_value(data, association, field, component):
    """The mesh with corners only, and one field in f64."""
    arrays = data.GetPointData() if association == "point" else data.GetCellData()
    array = vtk_to_numpy(arrays.GetArray(field)).astype(float)
    value = numpy_to_vtk(array if array.ndim == 1 else np.ascontiguousarray(array[:, component]), deep=1)
    value.SetName("value")
    result = vtk.vtkUnstructuredGrid()
    result.SetPoints(data.GetPoints())
    for cell in range(data.GetNumberOfCells()):
        kind = data.GetCellType(cell)
        ids = data.GetCell(cell).GetPointIds()
        n = CORNERS[kind]
        result.InsertNextCell(kind, n, [ids.GetId(i) for i in range(n)])
    (result.GetPointData() if association == "point" else result.GetCellData()).AddArray(value)
    return result


def cloud(data, seed):
    rng = np.random.default_rng(seed)
    bounds = np.array(data.GetBounds())
    low, high = bounds[::2], bounds[1::2]
    margin = 0.02 * (high - low)
    points = list(rng.uniform(low - margin, high + margin, (NUM_POINTS // 2, 3)))
    while len(points) < NUM_POINTS:
        cell = data.GetCell(int(rng.integers(data.GetNumberOfCells())))
        kind = cell.GetCellType()
        place = rng.uniform(0.02, 0.98, 3)
        if kind in (vtk.VTK_TETRA, vtk.VTK_WEDGE) and place[: 3 if kind == vtk.VTK_TETRA else 2].sum() > 0.98:
            continue
        world = [0.0] * 3
        cell.EvaluateLocation(vtk.mutable(0), place, world, [0.0] * 8)
        points.append(np.array(world))
    return np.array(points)


def accepting(data, point, bounds):
    """Cells that VTK says a point is in, and its place in each."""
    found = []
    for number in np.flatnonzero((bounds[:, ::2] <= point).all(1) & (point <= bounds[:, 1::2]).all(1)):
        weights, place, closest = [0.0] * 8, [0.0] * 3, [0.0] * 3
        cell = data.GetCell(int(number))
        if cell.EvaluatePosition(point, closest, vtk.mutable(0), place, vtk.mutable(0.0), weights) == 1:
            found.append((int(number), place))
    return found


def bounds_of_cells(data):
    return np.array([data.GetCell(i).GetBounds() for i in range(data.GetNumberOfCells())])


def unambiguous(data, points):
    """Points in at most one cell: where neighbours' faces do not match, cells overlap."""
    bounds = bounds_of_cells(data)
    return np.array([p for p in points if len(accepting(data, p, bounds)) <= 1])


def probe(data, points):
    poly = vtk.vtkPolyData()
    vtk_points = vtk.vtkPoints()
    vtk_points.SetData(numpy_to_vtk(np.ascontiguousarray(points), deep=1))
    poly.SetPoints(vtk_points)
    filter = vtk.vtkProbeFilter()
    filter.SetInputData(poly)
    filter.SetSourceData(data)
    filter.ComputeToleranceOff()
    filter.SetTolerance(1e-12)
    # The default walks from the nearest point, and loses itself in meshes with unused points.
    filter.SetCellLocator(vtk.vtkStaticCellLocator())
    filter.Update()
    output = filter.GetOutput().GetPointData()
    return (vtk_to_numpy(output.GetArray("vtkValidPointMask")).copy(),
            vtk_to_numpy(output.GetArray("value")).copy())


def refine(data, points, inside, values):
    bounds = bounds_of_cells(data)
    scalars = data.GetPointData().GetArray("value")
    for n in np.flatnonzero(inside):
        found = accepting(data, points[n], bounds)
        if not found:
            continue
        number, place = found[0]
        cell = data.GetCell(number)
        if cell.GetCellType() not in SHAPES:
            continue
        shape, count = SHAPES[cell.GetCellType()], cell.GetNumberOfPoints()
        corners = np.array([cell.GetPoints().GetPoint(i) for i in range(count)])
        place = np.array(place)
        for _ in range(20):
            weights, derivatives = [0.0] * count, [0.0] * (3 * count)
            shape.InterpolationFunctions(place, weights)
            shape.InterpolationDerivs(place, derivatives)
            error = np.array(weights) @ corners - points[n]
            place = place - np.linalg.solve((np.reshape(derivatives, (3, count)) @ corners).T, error)
        weights = [0.0] * count
        shape.InterpolationFunctions(place, weights)
        size = np.ptp(corners, axis=0).max()
        assert np.abs(np.array(weights) @ corners - points[n]).max() < 1e-12 * max(size, 1), (n, size)
        values[n] = sum(w * scalars.GetValue(cell.GetPointId(i)) for i, w in enumerate(weights))


def main():
    write_warped(HERE / "warped.vtu")
    for seed, (name, association, field, component) in enumerate([
            ("warped.vtu", "point", "wave", 0), ("can.vtu", "point", "DISPL", 2), ("can.vtu", "cell", "EQPS", 0),
            ("post.vtk", "point", "Pressure", 0), ("hexa.vtk", "point", "scalars", 0),
            ("notch_stress.vtk", "point", "Nodal Stress", 0), ("disk_out_ref.ex2", "point", "Temp", 0)]):
        data = with_value(read(name), association, field, component)
        points = unambiguous(data, cloud(data, seed))
        inside, values = probe(data, points)
        raw = values.copy()
        if association == "point":
            refine(data, points, inside, values)
        arrays = data.GetPointData() if association == "point" else data.GetCellData()
        low, high = arrays.GetArray("value").GetRange()
        change = np.abs(raw - values)[inside == 1].max() / (high - low)
        stem = f"{name.split('.')[0]}_{field.split()[0].lower()}"
        with open(HERE / "probe" / f"{stem}.csv", "w", newline="") as out:
            rows = csv.writer(out, lineterminator="\n")
            rows.writerow(["x", "y", "z", "inside", "value"])
            for point, is_in, value in zip(points, inside, values):
                shown = repr(float(value)) if is_in else ""
                rows.writerow([repr(float(c)) for c in point] + [int(is_in), shown])
        print(stem, int(inside.sum()), "of", len(points), "inside; the search changed", change)


main()
