"""Writes what VTK's probe filter finds at 200 random points of each file, as probe/NAME.csv.

    pip install vtk && python make_probe_points.py [avg152T1_RL_nifti.nii.gz]

Columns: x,y,z,inside,value (value empty outside). Values become f64 before probing, since VTK rounds
results to the type of the data. In curvilinear grids VTK stops its search for a point's place in
its cell at 1e-3 of the cell; here the search goes on, in the cell that VTK found and with VTK's own
shape functions, until the place is exact to 1e-13. NIfTI points are in the world of the file's
sform (or qform), although VTK keeps such grids in their own coordinates.
"""

import csv
import pathlib
import sys

import numpy as np
import vtk
from vtk.util import numpy_support

HERE = pathlib.Path(__file__).parent
NUM_POINTS = 200


def write_grid(kind, path):
    """A small rectilinear or curved grid with a smooth field and one on cells."""
    dims = (9, 8, 7)
    i, j, k = (a.ravel(order="F") for a in np.meshgrid(*map(np.arange, dims), indexing="ij"))
    if kind == "vtr":
        grid, writer = vtk.vtkRectilinearGrid(), vtk.vtkXMLRectilinearGridWriter()
        grid.SetDimensions(dims)
        for n, put in zip(dims, (grid.SetXCoordinates, grid.SetYCoordinates, grid.SetZCoordinates)):
            put(numpy_support.numpy_to_vtk(np.arange(n) ** 1.5 - n, deep=1))
    else:
        grid, writer = vtk.vtkStructuredGrid(), vtk.vtkXMLStructuredGridWriter()
        grid.SetDimensions(dims)
        angle, radius = 0.25 * i + 0.05 * k, 2 + 0.6 * j + 0.1 * np.sin(k)
        xyz = np.stack([radius * np.cos(angle), radius * np.sin(angle), k + 0.2 * np.sin(i + j)], 1)
        points = vtk.vtkPoints()
        points.SetData(numpy_support.numpy_to_vtk(np.ascontiguousarray(xyz), deep=1))
        grid.SetPoints(points)
    values = np.sin(0.7 * i) + np.cos(0.9 * j) * k
    values = numpy_support.numpy_to_vtk(values, deep=1)
    values.SetName("wave")
    grid.GetPointData().AddArray(values)
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    writer.Write()


def as_double(data):
    values = data.GetPointData().GetArray(0)
    double = numpy_support.vtk_to_numpy(values).astype(np.float64)
    double = numpy_support.numpy_to_vtk(double, deep=1)
    double.SetName("value")
    result = data.NewInstance()
    result.CopyStructure(data)
    result.GetPointData().AddArray(double)
    return result


def probe(data, points):
    """Whether each point is inside, and the value there."""
    cloud = vtk.vtkPolyData()
    cloud_points = vtk.vtkPoints()
    cloud_points.SetDataTypeToDouble()
    cloud_points.SetData(numpy_support.numpy_to_vtk(np.ascontiguousarray(points), deep=1))
    cloud.SetPoints(cloud_points)
    filter = vtk.vtkProbeFilter()
    filter.SetInputData(cloud)
    filter.SetSourceData(data)
    filter.ComputeToleranceOff()
    filter.SetTolerance(1e-12)
    filter.Update()
    output = filter.GetOutput().GetPointData()
    inside = numpy_support.vtk_to_numpy(output.GetArray("vtkValidPointMask")).copy()
    return inside, numpy_support.vtk_to_numpy(output.GetArray("value")).copy()


def refine(data, points, inside, values):
    """Ends the search for each point's place in its cell that VTK breaks off early."""
    locator = vtk.vtkStaticCellLocator()
    locator.SetDataSet(data)
    locator.BuildLocator()
    scalars = data.GetPointData().GetArray("value")
    for n in np.flatnonzero(inside):
        cell, place, weights = vtk.vtkGenericCell(), [0.0] * 3, [0.0] * 8
        found = locator.FindCell(points[n], 1e-12, cell, vtk.mutable(0), place, weights)
        assert found >= 0
        corners = np.array([cell.GetPoints().GetPoint(i) for i in range(8)])
        place = np.array(place)
        for _ in range(20):
            derivatives = [0.0] * 24
            vtk.vtkHexahedron.InterpolationFunctions(place, weights)
            vtk.vtkHexahedron.InterpolationDerivs(place, derivatives)
            error = np.array(weights) @ corners - points[n]
            place = place - np.linalg.solve((np.reshape(derivatives, (3, 8)) @ corners).T, error)
        vtk.vtkHexahedron.InterpolationFunctions(place, weights)
        assert np.abs(np.array(weights) @ corners - points[n]).max() < 1e-13
        assert place.min() > -1e-6 and place.max() < 1 + 1e-6
        ids = [cell.GetPointId(i) for i in range(8)]
        exact = sum(w * scalars.GetValue(i) for w, i in zip(weights, ids))
        assert abs(exact - values[n]) < 1e-3
        values[n] = exact


def write_csv(name, points, inside, values):
    (HERE / "probe").mkdir(exist_ok=True)
    with open(HERE / "probe" / f"{name}.csv", "w", newline="") as out:
        rows = csv.writer(out, lineterminator="\n")
        rows.writerow(["x", "y", "z", "inside", "value"])
        for point, is_in, value in zip(points, inside, values):
            shown = repr(float(value)) if is_in else ""
            rows.writerow([repr(float(c)) for c in point] + [int(is_in), shown])
    print(name, int(inside.sum()), "of", len(points), "inside")


def random_points(bounds, seed):
    low, high = np.array(bounds[::2]), np.array(bounds[1::2])
    margin = 0.05 * (high - low)
    rng = np.random.default_rng(seed)
    return rng.uniform(low - margin, high + margin, (NUM_POINTS, 3))


def read(path):
    readers = {
        "vti": vtk.vtkXMLImageDataReader, "vtr": vtk.vtkXMLRectilinearGridReader,
        "vts": vtk.vtkXMLStructuredGridReader, "vtk": vtk.vtkDataSetReader,
    }
    reader = readers[path.suffix[1:]]()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def probe_nifti(path):
    reader = vtk.vtkNIFTIImageReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = as_double(reader.GetOutput())
    header = reader.GetNIFTIHeader()
    use_sform = header.GetSFormCode() > 0
    matrix = reader.GetSFormMatrix() if use_sform else reader.GetQFormMatrix()
    print("NIfTI", "sform" if use_sform else "qform", matrix is not None)
    world_from_vtk = np.array([[matrix.GetElement(r, c) for c in range(4)] for r in range(4)])
    corners = data.GetBounds()
    corners = np.array([[corners[i], corners[2 + j], corners[4 + k], 1]
                        for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    world = (world_from_vtk @ corners.T).T[:, :3]
    bounds = np.stack([world.min(0), world.max(0)], 1).ravel()
    points = random_points(bounds, 6)
    homogeneous = np.hstack([points, np.ones((NUM_POINTS, 1))])
    inside, values = probe(data, (np.linalg.inv(world_from_vtk) @ homogeneous.T).T[:, :3])
    write_csv(path.name.split(".")[0], points, inside, values)


def main():
    write_grid("vtr", HERE / "stretched.vtr")
    write_grid("vts", HERE / "curved.vts")
    names = ["hydrogen.vti", "ironProt.vtk", "viscous_fingers_060.vti", "stretched.vtr", "curved.vts"]
    for seed, name in enumerate(names):
        data = as_double(read(HERE / name))
        points = random_points(data.GetBounds(), seed)
        inside, values = probe(data, points)
        if name.endswith("vts"):
            refine(data, points, inside, values)
        write_csv(name.split(".")[0], points, inside, values)
    for path in sys.argv[1:]:
        probe_nifti(pathlib.Path(path))


main()
