#!/usr/bin/env python3
"""Meshes and images in VTKHDF files, as VTK writes them and as its specification allows.

Run with VTK 9.7, h5py and NumPy in this folder:  python3 make_hdf_files.py
Writes hdf/*.vtkhdf, and what VTK reads from them: hdf/expected.txt.
"""
import os

import h5py
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtk.util.vtkAlgorithm import VTKPythonAlgorithmBase

import make_mesh_files as meshes

OUT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "hdf")
TIMES = [0.0, 0.25, 1.5]


class Steps(VTKPythonAlgorithmBase):
    """Gives what `make(step)` makes at each of the times."""

    def __init__(self, make, output):
        VTKPythonAlgorithmBase.__init__(self, nInputPorts=0, nOutputPorts=1, outputType=output)
        self.make = make

    def RequestInformation(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        keys = vtk.vtkStreamingDemandDrivenPipeline
        info.Set(keys.TIME_STEPS(), TIMES, len(TIMES))
        info.Set(keys.TIME_RANGE(), [TIMES[0], TIMES[-1]], 2)
        image = self.make(0)
        if isinstance(image, vtk.vtkImageData):
            info.Set(keys.WHOLE_EXTENT(), image.GetExtent(), 6)
        return 1

    def RequestData(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        key = vtk.vtkStreamingDemandDrivenPipeline.UPDATE_TIME_STEP()
        time = info.Get(key) if info.Has(key) else TIMES[0]
        step = TIMES.index(time)
        output = vtk.vtkDataObject.GetData(info)
        output.ShallowCopy(self.make(step))
        output.GetInformation().Set(vtk.vtkDataObject.DATA_TIME_STEP(), time)
        return 1


def writer(name, chunk=64, compression=0):
    to = vtk.vtkHDFWriter()
    to.SetFileName(os.path.join(OUT, name))
    to.SetChunkSize(chunk)
    to.SetCompressionLevel(compression)
    to.SetOverwrite(True)
    return to


def write(data, name, **options):
    to = writer(name, **options)
    to.SetInputDataObject(data)
    assert to.Write(), name
    return name


def write_steps(make, output, name, **options):
    to = writer(name, **options)
    source = Steps(make, output)
    to.SetInputConnection(source.GetOutputPort())
    to.SetWriteAllTimeSteps(True)
    assert to.Write(), name
    return name


def partitions(grid, count):
    """A partitioned data set: equal runs of cells, each with points of its own."""
    total = grid.GetNumberOfCells()
    parts = vtk.vtkPartitionedDataSet()
    for part in range(count):
        extract = vtk.vtkExtractCells()
        extract.SetInputData(grid)
        extract.SetAssumeSortedAndUniqueIds(True)
        ids = vtk.vtkIdList()
        for cell in range(total * part // count, total * (part + 1) // count):
            ids.InsertNextId(cell)
        extract.SetCellList(ids)
        extract.Update()
        piece = vtk.vtkUnstructuredGrid()
        piece.ShallowCopy(extract.GetOutput())
        piece.GetPointData().RemoveArray("vtkOriginalPointIds")
        piece.GetCellData().RemoveArray("vtkOriginalCellIds")
        parts.SetPartition(part, piece)
    return parts


def appended(parts):
    """The partitions as one grid, the points of the first first."""
    append = vtk.vtkAppendFilter()
    for part in range(parts.GetNumberOfPartitions()):
        append.AddInputData(parts.GetPartition(part))
    append.MergePointsOff()
    append.Update()
    return append.GetOutput()


def at_step(grid, step):
    """A mesh whose point values are those of the first step plus its time."""
    moved = vtk.vtkUnstructuredGrid()
    moved.DeepCopy(grid)
    wave = vtk_to_numpy(moved.GetPointData().GetArray("wave"))
    wave += TIMES[step]
    number = vtk_to_numpy(moved.GetCellData().GetArray("number"))
    number += 1000 * step
    return moved


def at_step_of_one_mesh(grid):
    """As `at_step`, points and cells being the same objects, so that VTK writes them once."""

    def make(step):
        moved = at_step(grid, step)
        moved.SetPoints(grid.GetPoints())
        moved.SetCells(grid.GetCellTypes(),
                       grid.GetCells())
        return moved

    return make


def changing(step):
    """Another mesh at every step."""
    return at_step(meshes.mixed(seed=10 + step, low=False) if step != 1 else meshes.tets(np.float32), step)


def image(step=0):
    grid = vtk.vtkImageData()
    grid.SetExtent(2, 6, -1, 2, 0, 3)
    grid.SetOrigin(1.0, 2.0, 3.0)
    grid.SetSpacing(0.5, 0.25, 2.0)
    rng = np.random.default_rng(20)
    meshes_points, cells = grid.GetNumberOfPoints(), grid.GetNumberOfCells()

    def add(data, values, name):
        array = numpy_to_vtk(values, deep=1)
        array.SetName(name)
        data.AddArray(array)

    add(grid.GetPointData(), rng.normal(size=meshes_points).astype(np.float32) + np.float32(TIMES[step]), "noise")
    add(grid.GetPointData(), rng.normal(size=(meshes_points, 3)), "arrow")
    add(grid.GetCellData(), rng.integers(0, 255, cells).astype(np.uint8), "byte")
    return grid


def by_hand(name, grid, libver, order="<", base=0, filters=None, version=(1, 0)):
    """The specification's layout with h5py: contiguous unless there are filters."""
    path = os.path.join(OUT, name)
    more = filters or {}
    with h5py.File(path, "w", libver=libver, userblock_size=base) as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array(version, "i8")
        root.attrs["Type"] = np.bytes_("UnstructuredGrid")

        def put(group, key, values):
            values = np.asarray(values)
            options = dict(more)
            if "maxshape" in options:
                options["maxshape"] = (None,) + (None if options["maxshape"] == 2 else 3,) * (values.ndim - 1)
            if "chunks" in options:
                options["chunks"] = (options["chunks"],) + (2,) * (values.ndim - 1)
                if "maxshape" not in options:
                    options["chunks"] = tuple(min(c, n) for c, n in zip(options["chunks"], values.shape))
            group.create_dataset(key, data=values.astype(values.dtype.newbyteorder(order)), **options)

        cells = grid.GetCells()
        connectivity = vtk_to_numpy(cells.GetConnectivityArray())
        put(root, "Points", vtk_to_numpy(grid.GetPoints().GetData()))
        put(root, "Types", vtk_to_numpy(grid.GetCellTypes()))
        put(root, "Connectivity", connectivity)
        put(root, "Offsets", vtk_to_numpy(cells.GetOffsetsArray()))
        put(root, "NumberOfPoints", np.array([grid.GetNumberOfPoints()]))
        put(root, "NumberOfCells", np.array([grid.GetNumberOfCells()]))
        put(root, "NumberOfConnectivityIds", np.array([len(connectivity)]))
        for group, data in (("PointData", grid.GetPointData()), ("CellData", grid.GetCellData())):
            group = root.create_group(group)
            for i in range(data.GetNumberOfArrays()):
                array = data.GetArray(i)
                put(group, array.GetName(), vtk_to_numpy(array))
    return name


def read(name, step=None):
    reader = vtk.vtkHDFReader()
    reader.SetFileName(os.path.join(OUT, name))
    if hasattr(reader, "SetMergeParts"):
        reader.SetMergeParts(False)
    reader.UpdateInformation()
    if step is not None:
        reader.UpdateTimeStep(TIMES[step])
    reader.Update()
    return reader.GetOutputDataObject(0)


def expected(to, grid, files, step=None):
    meshes.expected(to, grid, files)
    if step is not None:
        to.write(f"step {step}\n")


def expected_image(to, grid, files, step=None):
    to.write("image\n")
    to.write("bounds " + meshes.text(np.array(grid.GetBounds())) + "\n")
    to.write("points " + " ".join(map(str, grid.GetDimensions())) + "\n")
    for association, data in (("point", grid.GetPointData()), ("cell", grid.GetCellData())):
        for i in range(data.GetNumberOfArrays()):
            array = data.GetArray(i)
            values = vtk_to_numpy(array)
            kind = values.dtype.kind + str(8 * values.dtype.itemsize)
            to.write(f"field {association} {kind} {array.GetNumberOfComponents()} {array.GetName()}\n")
            to.write(f"values {meshes.text(values.ravel())}\n")
    for name in files:
        to.write(f"file {name}\n")
    if step is not None:
        to.write(f"step {step}\n")


def main():
    os.makedirs(OUT, exist_ok=True)
    with open(os.path.join(OUT, "expected.txt"), "w") as to:
        grid = meshes.mixed()
        files = [write(grid, "mixed.vtkhdf"), write(grid, "mixed_zlib.vtkhdf", compression=6),
                 by_hand("mixed_flat.vtkhdf", grid, "earliest"),
                 by_hand("mixed_latest.vtkhdf", grid, "latest", version=(2, 0)),
                 by_hand("mixed_big.vtkhdf", grid, "earliest", order=">"),
                 by_hand("mixed_user_block.vtkhdf", grid, "latest", base=512),
                 # One kind of index over chunks each: one chunk, fixed, growing one way, both ways.
                 by_hand("mixed_chunk.vtkhdf", grid, "latest", filters={"chunks": 500}),
                 by_hand("mixed_shuffle.vtkhdf", grid, "latest",
                         filters={"compression": "gzip", "shuffle": True, "fletcher32": True, "chunks": 7}),
                 by_hand("mixed_growing.vtkhdf", grid, "latest", filters={"maxshape": 1, "chunks": 5}),
                 by_hand("mixed_growing_both.vtkhdf", grid, "latest",
                         filters={"maxshape": 2, "chunks": 5, "compression": "gzip"})]
        expected(to, read(files[0]), files)
        parts = partitions(meshes.tets(), 3)
        files = [write(parts, "parts.vtkhdf", compression=4)]
        expected(to, appended(parts), files)
        base = meshes.mixed(low=False)
        name = write_steps(lambda step: at_step(base, step), "vtkUnstructuredGrid", "steps.vtkhdf")
        for step in range(len(TIMES)):
            expected(to, at_step(base, step), [name], step)
        name = write_steps(at_step_of_one_mesh(base), "vtkUnstructuredGrid", "static.vtkhdf")
        for step in range(len(TIMES)):
            expected(to, at_step(base, step), [name], step)
        name = write_steps(changing, "vtkUnstructuredGrid", "changing.vtkhdf")
        for step in range(len(TIMES)):
            expected(to, changing(step), [name], step)
        expected_image(to, image(), [write(image(), "image.vtkhdf")])
        name = write_steps(image, "vtkImageData", "image_steps.vtkhdf")
        for step in range(len(TIMES)):
            expected_image(to, image(step), [name], step)
    write(meshes.zoo(), "zoo.vtkhdf")
    write(meshes.hidden(), "hidden.vtkhdf")
    collection = vtk.vtkPartitionedDataSetCollection()
    collection.SetPartitionedDataSet(0, partitions(meshes.tets(), 2))
    other = vtk.vtkPartitionedDataSet()
    other.SetPartition(0, meshes.tets())
    collection.SetPartitionedDataSet(1, other)
    write(collection, "collection.vtkhdf")
    sphere = vtk.vtkSphereSource()
    sphere.Update()
    write(sphere.GetOutput(), "sphere.vtkhdf")


if __name__ == "__main__":
    main()
