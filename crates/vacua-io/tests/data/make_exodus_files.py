#!/usr/bin/env python3
"""A small Exodus II file of three blocks and three time steps in the containers that NetCDF has.

Run with netCDF4 and NumPy in this folder:  python3 make_exodus_files.py
Writes mesh/blocks.ex2 (CDF-1), mesh/blocks.exo (CDF-2), mesh/blocks.e (CDF-5), hdf/blocks.g (HDF5),
and hdf/disk_out_ref.e: disk_out_ref.ex2 as NetCDF's own library writes it in HDF5. Values are closed forms of positions, cells and time, which the tests repeat; that VTK reads
the same is checked here if it is installed.
"""
import os

import netCDF4
import numpy as np

OUT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "mesh")
TIMES = [0.0, 0.5, 2.0]
# Two stacked cubes, a tetrahedron on top.
POINTS = np.array([[x, y, z] for z in range(3) for y in range(2) for x in range(2)] + [[0.5, 0.5, 3.0]], float)
HEX = np.array([[0, 1, 3, 2, 4, 5, 7, 6], [4, 5, 7, 6, 8, 9, 11, 10]])
TET = np.array([[8, 9, 11, 12]])
SHELL = np.array([[0, 1, 3, 2]])


def text(variable, values):
    for i, value in enumerate(values):
        variable[i, : len(value)] = np.array(list(value), "S1")


def write(name, container, compress=False):
    path = os.path.join(OUT, name)
    wide = container in ("NETCDF3_64BIT_DATA",)
    data = netCDF4.Dataset(path, "w", format=container)
    data.title = "three blocks"
    data.api_version = data.version = np.float32(7.22)
    data.floating_point_word_size = np.int32(8)
    data.file_size = np.int32(1)
    data.maximum_name_length = np.int32(32)
    data.int64_status = np.int32(0)
    more = {"zlib": True, "shuffle": True} if compress else {}
    for dimension, length in [("len_string", 33), ("len_name", 33), ("four", 4),
                              ("time_step", None), ("num_dim", 3),
                              ("num_nodes", len(POINTS)), ("num_elem", 4), ("num_el_blk", 3),
                              ("num_el_in_blk1", 2), ("num_nod_per_el1", 8), ("num_el_in_blk2", 1),
                              ("num_nod_per_el2", 4), ("num_el_in_blk3", 1), ("num_nod_per_el3", 4),
                              ("num_side_sets", 1), ("num_side_ss1", 3), ("num_nod_var", 5),
                              ("num_elem_var", 2)]:
        data.createDimension(dimension, length)
    whole = "i8" if wide else "i4"
    data.createVariable("eb_status", "i4", ("num_el_blk",))[:] = 1
    data.createVariable("ss_status", "i4", ("num_side_sets",))[:] = 1
    data.createVariable("ss_prop1", "i4", ("num_side_sets",))[:] = 1
    table = data.createVariable("elem_var_tab", "i4", ("num_el_blk", "num_elem_var"))
    table[:] = [[1, 1], [1, 0], [1, 0]]
    data.createVariable("time_whole", "f8", ("time_step",))[:] = TIMES
    data.createVariable("eb_prop1", "i4", ("num_el_blk",))[:] = [10, 20, 30]
    for axis, letter in enumerate("xyz"):
        data.createVariable(f"coord{letter}", "f8", ("num_nodes",), **more)[:] = POINTS[:, axis]
    for block, (kind, cells) in enumerate([("HEX8", HEX), ("TETRA", TET), ("SHELL4", SHELL)], 1):
        connect = data.createVariable(f"connect{block}", whole,
                                      (f"num_el_in_blk{block}", f"num_nod_per_el{block}"))
        connect.elem_type = kind
        connect[:] = cells + 1
    data.createVariable("elem_ss1", "i4", ("num_side_ss1",))[:] = [1, 2, 3]
    data.createVariable("side_ss1", "i4", ("num_side_ss1",))[:] = [5, 1, 2]
    names = ["Temp", "dispX", "dispY", "dispZ", "p"]
    text(data.createVariable("name_nod_var", "S1", ("num_nod_var", "len_name")), names)
    text(data.createVariable("name_elem_var", "S1", ("num_elem_var", "len_name")), ["stress", "gap"])
    line = POINTS @ [1.0, 2.0, 4.0]
    for number in range(5):
        variable = data.createVariable(f"vals_nod_var{number + 1}", "f8", ("time_step", "num_nodes"), **more)
        for step, time in enumerate(TIMES):
            variable[step, :] = line * (number + 1) + time
    # `gap` is in the first block only.
    for number, block, cells in [(1, 1, 2), (1, 2, 1), (1, 3, 1), (2, 1, 2)]:
        variable = data.createVariable(f"vals_elem_var{number}eb{block}", "f8",
                                       ("time_step", f"num_el_in_blk{block}"))
        for step, time in enumerate(TIMES):
            variable[step, :] = 100 * number + 10 * block + np.arange(cells) + time
    data.close()
    return path


def check(path):
    try:
        import vtk
        from vtk.util.numpy_support import vtk_to_numpy
    except ImportError:
        return
    reader = vtk.vtkExodusIIReader()
    reader.SetFileName(path)
    reader.UpdateInformation()
    reader.SetTimeStep(1)
    reader.SetApplyDisplacements(False)
    reader.SetAllArrayStatus(vtk.vtkExodusIIReader.NODAL, 1)
    reader.SetAllArrayStatus(vtk.vtkExodusIIReader.ELEM_BLOCK, 1)
    reader.Update()
    block = reader.GetOutput().GetBlock(0).GetBlock(0)
    assert block.GetNumberOfCells() == 2, path
    disp = vtk_to_numpy(block.GetPointData().GetArray("disp"))
    assert disp.shape[1] == 3 and disp[0].tolist() == [0.5, 0.5, 0.5], disp
    assert vtk_to_numpy(block.GetCellData().GetArray("stress")).tolist() == [110.5, 111.5]


def convert(name, to):
    """A copy of a file in HDF5, its larger variables compressed."""
    here = os.path.dirname(OUT)
    source = netCDF4.Dataset(os.path.join(here, name))
    copy = netCDF4.Dataset(os.path.join(here, to), "w", format="NETCDF4")
    copy.setncatts({key: source.getncattr(key) for key in source.ncattrs()})
    for key, dimension in source.dimensions.items():
        copy.createDimension(key, None if dimension.isunlimited() else len(dimension))
    for key, variable in source.variables.items():
        large = variable.size > 200
        made = copy.createVariable(key, variable.dtype, variable.dimensions, zlib=large, shuffle=large,
                                   complevel=9)
        made.setncatts({a: variable.getncattr(a) for a in variable.ncattrs() if a != "_FillValue"})
        for either in (variable, made):
            either.set_auto_mask(False)
        made[:] = variable[:]
    copy.close()


if __name__ == "__main__":
    for name, container in [("blocks.ex2", "NETCDF3_CLASSIC"), ("blocks.exo", "NETCDF3_64BIT_OFFSET"),
                            ("blocks.e", "NETCDF3_64BIT_DATA")]:
        check(write(name, container))
    check(write("../hdf/blocks.g", "NETCDF4", compress=True))
    convert("disk_out_ref.ex2", "hdf/disk_out_ref.e")
