//! Writing NRRD: header and data in one file, raw or gzip.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use vacua_volume::ScalarType;

use crate::atomic::write_atomically;
use crate::error::IoError;
use crate::save::{DATA_ALIGN, Saved, Voxels, WriteFormat};

/// Writing NRRD files.
pub(crate) const WRITER: WriteFormat = WriteFormat {
    name: "NRRD",
    extensions: &["nrrd"],
    write,
};

fn type_name(scalar_type: ScalarType) -> &'static str {
    match scalar_type {
        ScalarType::F32 => "float",
        ScalarType::F64 => "double",
        ScalarType::U8 => "uint8",
        ScalarType::I8 => "int8",
        ScalarType::U16 => "uint16",
        ScalarType::I16 => "int16",
        ScalarType::U32 => "uint32",
        ScalarType::I32 => "int32",
        ScalarType::U64 => "uint64",
        ScalarType::I64 => "int64",
    }
}

fn write(path: &Path, voxels: &Voxels) -> Result<Saved, IoError> {
    let header = header(voxels);
    let data = voxels.little_endian_bytes();
    write_atomically(path, |w| {
        w.write_all(header.as_bytes())?;
        if !voxels.compress {
            return w.write_all(&data);
        }
        let mut packer = GzEncoder::new(w, Compression::default());
        packer.write_all(&data)?;
        packer.finish().map(|_| ())
    })?;
    Ok(Vec::new())
}

fn header(voxels: &Voxels) -> String {
    let [x, y, z] = voxels.grid.points();
    let components = voxels.values.components();
    let (axes, origin) = voxels.axes_and_origin();
    let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let (dimension, sizes, kinds, none) = if components == 1 {
        (3, String::new(), "", "")
    } else {
        (4, format!("{components} "), "vector ", "none ")
    };
    let encoding = if voxels.compress { "gzip" } else { "raw" };
    let space = match super::space_name(voxels.frame) {
        Some(name) => format!("space: {name}"),
        None => "space dimension: 3".to_owned(),
    };
    let mut text = String::from("NRRD0005\n");
    // Writing to a string cannot fail.
    let _ = write!(
        text,
        "type: {}\ndimension: {dimension}\n{space}\nsizes: {sizes}{x} {y} {z}\n\
         space directions: {none}{} {} {}\nkinds: {kinds}domain domain domain\n\
         endian: little\nencoding: {encoding}\nspace origin: {}\n",
        type_name(voxels.values.scalar_type()),
        vector(axes[0]),
        vector(axes[1]),
        vector(axes[2]),
        vector(origin),
    );
    // A comment makes the data start where it can be mapped.
    let comment_len = (text.len() + 3).next_multiple_of(DATA_ALIGN) - text.len() - 3;
    let _ = write!(text, "#{:-<comment_len$}\n\n", "");
    text
}
