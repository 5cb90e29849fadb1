"""Makes the multi-block sets here; series.pvd is by hand, as ParaView writes collections.

Run with VTK 9.7 in this folder:  python3 make.py
"""
import vtk


def mesh(shift, cells):
    """Tetrahedra in a row with u = shift + number of the point."""
    grid, points, values = vtk.vtkUnstructuredGrid(), vtk.vtkPoints(), vtk.vtkFloatArray()
    grid.SetPoints(points)
    grid.Allocate(cells)
    values.SetName("u")
    for cell in range(cells):
        ids = vtk.vtkIdList()
        for x, y, z in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]:
            point = points.InsertNextPoint(shift + cell + x, y, z)
            values.InsertNextValue(shift + point)
            ids.InsertNextId(point)
        grid.InsertNextCell(vtk.VTK_TETRA, ids)
    grid.GetPointData().AddArray(values)
    return grid


def write(name, blocks):
    writer = vtk.vtkXMLMultiBlockDataWriter()
    writer.SetFileName(name)
    writer.SetInputData(blocks)
    writer.Write()


def put(blocks, number, block, name):
    blocks.SetBlock(number, block)
    if name:
        blocks.GetMetaData(number).Set(vtk.vtkCompositeDataSet.NAME(), name)


inner, outer = vtk.vtkMultiBlockDataSet(), vtk.vtkMultiBlockDataSet()
put(inner, 0, mesh(10, 2), "solid")
put(outer, 0, mesh(0, 1), "air")
put(outer, 1, None, None)
put(outer, 2, inner, "wall")
write("two.vtm", outer)
image = vtk.vtkImageData()
image.SetDimensions(2, 2, 2)
put(outer, 1, image, "box")
write("unlike.vtm", outer)
