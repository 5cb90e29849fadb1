"""Makes the files here with the libraries that own the formats, and what a reader must find.

    pip install numpy SimpleITK pynrrd nibabel && python make.py

`expected.tsv` has one line a file: name, number type, components, points in x, y, z, the affine
map from index to world (three rows of four), and two sums over all numbers in order of memory
(component fastest, then x, y, z): plain, and weighted with 1 + position modulo 97. The values
come from reading each file back with its library. The averaged brain is from the NIfTI
working group's example files (public domain), via the VTK example data.
"""

import os

import nibabel as nib
import nrrd
import numpy as np
import SimpleITK as sitk

HERE = os.path.dirname(os.path.abspath(__file__))
os.chdir(HERE)
X, Y, Z = 5, 4, 3
random = np.random.default_rng(7)
lines = []
NAMES = {"f2": "f32", "b1": "u8"}


def expect(name, values, affine, type_name=None):
    """values: (z, y, x) or (z, y, x, c)."""
    if values.ndim == 3:
        values = values[..., None]
    flat = np.ascontiguousarray(values).ravel().astype(np.float64)
    code = values.dtype.str[1:]
    kind, size = code[0], int(code[1:]) * 8
    type_name = type_name or NAMES.get(code, f"{kind}{size}")
    weighted = float(np.sum(flat * (np.arange(flat.size) % 97 + 1)))
    z, y, x, c = values.shape
    numbers = [c, x, y, z, *np.asarray(affine, float)[:3].ravel(), float(flat.sum()), weighted]
    lines.append("\t".join([name, type_name, *(repr(n) for n in map(float, numbers))]))


def values(code, *shape):
    kind = np.dtype(code)
    if kind.kind == "b":
        return random.integers(0, 2, shape).astype(kind)
    if kind.kind in "ui":
        low = 0 if kind.kind == "u" else -100
        return random.integers(low, 120, shape).astype(kind)
    return (random.integers(-1000, 1000, shape) / 8).astype(kind)


# NumPy
for code in ["<u1", "<i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8",
             ">f4", ">i2", "<f2", ">f2", "|b1"]:
    name = f"c_{code.translate(str.maketrans('<>|', 'lbn'))}.npy"
    array = values(code, Z, Y, X)
    np.save(name, array)
    expect(name, np.load(name), np.eye(4))
for name, code, shape in [("fortran_lf8.npy", "<f8", (Z, Y, X)), ("fortran_bi2_3.npy", ">i2", (Z, Y, X, 3))]:
    np.save(name, np.asfortranarray(values(code, *shape)))
    expect(name, np.load(name), np.eye(4))
for version in [(2, 0), (3, 0)]:
    name = f"version{version[0]}_rgba.npy"
    with open(name, "wb") as f:
        np.lib.format.write_array(f, values("u1", Z, Y, X, 4), version=version)
    expect(name, np.load(name), np.eye(4))

# NRRD and MetaImage by ITK
angle = 0.3
rotation = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
tilt = np.array([[1, 0, 0], [0, np.cos(0.5), -np.sin(0.5)], [0, np.sin(0.5), np.cos(0.5)]])
direction = rotation @ tilt


def itk_affine(image):
    affine = np.eye(4)
    affine[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) @ np.diag(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    return affine


def itk_file(name, array, compress=False, oriented=True):
    image = sitk.GetImageFromArray(array, isVector=array.ndim == 4)
    if oriented:
        image.SetDirection(direction.ravel().tolist())
        image.SetSpacing((0.5, 2.0, 1.25))
        image.SetOrigin((-10.0, 3.5, 7.0))
    sitk.WriteImage(image, name, useCompression=compress)
    itk_expect(name)


def itk_expect(name):
    back = sitk.ReadImage(name)
    expect(name, sitk.GetArrayFromImage(back), itk_affine(back))


for extension in ["nrrd", "mha"]:
    itk_file(f"itk_i16.{extension}", values("i2", Z, Y, X))
    itk_file(f"itk_f32_zip.{extension}", values("f4", Z, Y, X), compress=True)
    itk_file(f"itk_vector.{extension}", values("f8", Z, Y, X, 3))
    itk_file(f"itk_u64.{extension}", values("u8", Z, Y, X), oriented=False)
itk_file("itk_rgb_zip.nrrd", values("u1", Z, Y, X, 3), compress=True)
itk_file("itk_header.nhdr", values("u2", Z, Y, X))
itk_file("itk_detached.mhd", values("i4", Z, Y, X))
itk_file("itk_detached_zip.mhd", values("u1", Z, Y, X), compress=True)

# Data in slices, as text, big-endian, or after bytes to skip: headers by hand, read back by ITK
# (whose NRRD reader is teem's own), which judges them.
slices = values(">i2", Z, Y, X)
for z in range(Z):
    slices[z].tofile(f"slice{z:02}.raw")
with open("skip.raw", "wb") as f:
    f.write(b"0123456")
    f.write(slices.tobytes())
with open("numbers.txt", "w") as f:
    f.write("\n".join(" ".join(str(v) for v in row) for row in slices.reshape(-1, X)) + "\n")
meta = f"ObjectType = Image\nNDims = 3\nDimSize = {X} {Y} {Z}\nElementType = MET_SHORT\nElementSpacing = 1 2 3\nPosition = 4 5 6\n"
big = "BinaryData = True\nBinaryDataByteOrderMSB = True\n"
with open("list.mhd", "w") as f:
    f.write(meta + big + "ElementDataFile = LIST\n" + "".join(f"slice{z:02}.raw\n" for z in range(Z)))
with open("pattern.mhd", "w") as f:
    f.write(meta + big + "ElementDataFile = slice%02d.raw 0 2 1\n")
with open("skip.mhd", "w") as f:
    f.write(meta + big + "HeaderSize = 7\nElementDataFile = skip.raw\n")
with open("skip_end.mhd", "w") as f:
    f.write(meta + big + "HeaderSize = -1\nElementDataFile = skip.raw\n")
with open("text.mhd", "w") as f:
    f.write(meta + "BinaryData = False\nElementDataFile = numbers.txt\n")
for name in ["list.mhd", "pattern.mhd", "skip.mhd", "skip_end.mhd", "text.mhd"]:
    itk_expect(name)


def nrrd_expect(name):
    array, header = nrrd.read(name, index_order="F")
    affine = np.eye(4)
    directions = header.get("space directions")
    if directions is not None:
        spatial = [d for d in directions if d is not None and not np.isnan(d).any()]
        affine[:3, :3] = np.array(spatial).T
        affine[:3, 3] = header.get("space origin", (0, 0, 0))
    elif "spacings" in header:
        affine[:3, :3] = np.diag(header["spacings"])
    if array.ndim == 4 and header["kinds"][0] == "vector":
        array = array.transpose(3, 2, 1, 0)
    elif array.ndim == 4:
        array = array.transpose(2, 1, 0, 3)
    else:
        array = array.T
    expect(name, array, affine)


head = f"NRRD0004\ntype: short\ndimension: 3\nsizes: {X} {Y} {Z}\nspacings: 1 2 3\nencoding: raw\nendian: big\n"
with open("list.nhdr", "w") as f:
    f.write(head + "data file: LIST\n" + "".join(f"slice{z:02}.raw\n" for z in range(Z)))
with open("pattern.nhdr", "w") as f:
    f.write(head + "data file: slice%02d.raw 0 2 1\n")
with open("skip.nhdr", "w") as f:
    f.write(head + "byte skip: 7\ndata file: skip.raw\n")
with open("skip_end.nhdr", "w") as f:
    f.write(head + "byte skip: -1\ndata file: ./skip.raw\n")
for name in ["list.nhdr", "pattern.nhdr", "skip.nhdr", "skip_end.nhdr"]:
    itk_expect(name)

# pynrrd
oriented = {
    "space": "left-posterior-superior",
    "space directions": (direction @ np.diag([0.5, 2, 1.25])).T,
    "space origin": [1.0, 2.0, 3.0],
}
for encoding in ["raw", "gzip", "bzip2", "ascii"]:
    name = f"pynrrd_{encoding}.nrrd"
    nrrd.write(name, values("f8" if encoding != "ascii" else "i2", X, Y, Z), {**oriented, "encoding": encoding})
    nrrd_expect(name)
nrrd.write("pynrrd_big.nrrd", values(">f4", X, Y, Z), {"encoding": "raw", "spacings": [1.0, 2.0, 0.5]})
nrrd_expect("pynrrd_big.nrrd")
nrrd.write("pynrrd_first.nrrd", values("u1", 2, X, Y, Z), {
    "encoding": "gzip", "kinds": ["vector", "domain", "domain", "domain"]})
nrrd_expect("pynrrd_first.nrrd")
nrrd.write("pynrrd_last.nrrd", values("i2", X, Y, Z, 3), {
    "encoding": "gzip", "kinds": ["domain", "domain", "domain", "vector"]})
nrrd_expect("pynrrd_last.nrrd")
nrrd.write("pynrrd_detached.nhdr", values("i4", X, Y, Z), {**oriented, "encoding": "gzip"}, detached_header=True)
nrrd_expect("pynrrd_detached.nhdr")


# NIfTI by nibabel
def nifti_expect(name, raw=None):
    image = nib.load(name)
    array = raw if raw is not None else np.asanyarray(image.dataobj)
    if array.dtype.fields:
        array = np.stack([array[c] for c in array.dtype.names], axis=-1)
    if array.ndim == 5:
        array = array[:, :, :, 0, :]
    elif array.ndim == 4 and array.shape[3] > 1 and image.header["datatype"] != 128:
        array = array[..., 0]
    order = (2, 1, 0) if array.ndim == 3 else (2, 1, 0, 3)
    expect(name, array.transpose(order), image.affine)


affine = np.eye(4)
affine[:3, :3] = direction @ np.diag([-0.5, 2, 1.25])
affine[:3, 3] = [1, -2, 3.5]
shear = affine.copy()
shear[0, 2] += 0.25
for code in ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"]:
    image = nib.Nifti1Image(values(code, X, Y, Z), shear, dtype=np.dtype(code))
    image.set_qform(None, code=0)
    image.header.set_slope_inter(1, 0)
    name = f"nib_{code}.nii"
    nib.save(image, name)
    nifti_expect(name)
image = nib.Nifti1Image(values("i2", X, Y, Z), affine)
image.set_qform(affine, code=1)
image.set_sform(None, code=0)
nib.save(image, "nib_qform.nii.gz")
nifti_expect("nib_qform.nii.gz")
image = nib.Nifti1Image(values("f4", X, Y, Z), shear)
image.set_qform(affine, code=2)
image.set_sform(shear, code=4)
nib.save(image, "nib_both.nii.gz")
nifti_expect("nib_both.nii.gz")
big_header = nib.Nifti1Header(endianness=">")
big_header.set_data_dtype(np.dtype(">i2"))
nib.save(nib.Nifti1Image(values(">i2", X, Y, Z), affine, big_header), "nib_big.nii")
nifti_expect("nib_big.nii")
nib.save(nib.Nifti2Image(values("f8", X, Y, Z), shear), "nib_2.nii")
nifti_expect("nib_2.nii")
big_header = nib.Nifti2Header(endianness=">")
big_header.set_data_dtype(np.dtype(">u2"))
nib.save(nib.Nifti2Image(values(">u2", X, Y, Z), affine, big_header), "nib_2_big.nii.gz")
nifti_expect("nib_2_big.nii.gz")
nib.save(nib.Nifti1Pair(values("i4", X, Y, Z), affine), "nib_pair.hdr")
nifti_expect("nib_pair.hdr")
nib.save(nib.Nifti1Image(values("i2", X, Y, Z, 2), affine), "nib_steps.nii.gz")
nifti_expect("nib_steps.nii.gz")
rgb = values("u1", X, Y, Z, 3)
nib.save(nib.Nifti1Image(rgb.view([("R", "u1"), ("G", "u1"), ("B", "u1")])[..., 0], affine), "nib_rgb.nii")
nifti_expect("nib_rgb.nii")
scaled = nib.Nifti1Image(values("i2", X, Y, Z), affine)
scaled.header.set_slope_inter(0.25, -3)
nib.save(scaled, "nib_scaled.nii")
stored = nib.load("nib_scaled.nii")
nifti_expect("nib_scaled.nii", np.asanyarray(stored.dataobj).astype("f4"))
# Several values a voxel in the fifth dimension, as ITK writes them.
image = sitk.GetImageFromArray(values("f4", Z, Y, X, 3), isVector=True)
image.SetSpacing((1.0, 2.0, 3.0))
sitk.WriteImage(image, "itk_vector.nii.gz")
nifti_expect("itk_vector.nii.gz")
nifti_expect("avg152T1_RL_nifti.nii.gz")

# One image in several anatomical frames. ITK turns NIfTI's RAS into its own LPS; in the others the
# frame is only a name for coordinates that are turned here.
image = sitk.ReadImage("nib_qform.nii.gz")
for name in ["frame_lps.mha", "frame_lps.nrrd"]:
    sitk.WriteImage(image, name)
    itk_expect(name)
source = nib.load("nib_qform.nii.gz")
for name, space, signs in [
    ("frame_ras.nrrd", "right-anterior-superior", [1, 1, 1]),
    ("frame_las.nrrd", "LAS", [-1, 1, 1]),
]:
    turned = np.diag(signs) @ source.affine[:3]
    header = {"space": space, "space directions": turned[:, :3].T, "space origin": turned[:, 3], "encoding": "raw"}
    nrrd.write(name, np.asanyarray(source.dataobj), header)
    nrrd_expect(name)

with open("expected.tsv", "w") as f:
    f.write("\n".join(lines) + "\n")
