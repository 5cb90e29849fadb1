//! Files out: the list of formats that vacua writes, and the choice among them by extension.

use std::borrow::Cow;
use std::path::Path;

use glam::{DAffine3, DVec3};
use vacua_volume::{
    Association, DataArray, Dataset, FieldChoice, Geometry, UniformGrid, WorldFrame,
};

use crate::decode::{Endianness, swap_bytes};
use crate::error::{IoError, Problem};
use crate::vtk;

/// What the command line may say about a file to be written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WriteOptions {
    /// The field to write, where the format holds one.
    pub field: FieldChoice,
    /// Whether to compress, where the format can.
    pub compress: bool,
}

/// Data after a text header starts at a multiple of this, so that it can be mapped: for any number
/// type and for vector instructions.
pub(crate) const DATA_ALIGN: usize = 64;

/// What a format could not hold of what it was given; empty if nothing was lost.
pub type Saved = Vec<String>;

/// One format that voxels can be written in.
pub(crate) struct WriteFormat {
    /// What people call it.
    pub(crate) name: &'static str,
    /// Extensions, lower case, without the dot.
    pub(crate) extensions: &'static [&'static str],
    /// Writes the whole file or nothing.
    pub(crate) write: fn(&Path, &Voxels) -> Result<Saved, IoError>,
}

/// All formats that [`save`] knows.
const WRITERS: &[WriteFormat] = &[
    crate::npy::WRITER,
    crate::nrrd::WRITER,
    crate::metaimage::WRITER,
    crate::raw::WRITER,
];

/// Values on the points of a uniform grid, on their way to a file.
pub(crate) struct Voxels<'a> {
    /// Where the points are.
    pub(crate) grid: &'a UniformGrid,
    /// What the axes of the world mean.
    pub(crate) frame: WorldFrame,
    /// One tuple a point.
    pub(crate) values: &'a DataArray,
    /// Whether to compress, where the format can.
    pub(crate) compress: bool,
}

impl Voxels<'_> {
    /// The numbers, lowest byte first; borrowed on machines that keep them so.
    pub(crate) fn little_endian_bytes(&self) -> Cow<'_, [u8]> {
        let bytes = self.values.bytes();
        if Endianness::NATIVE == Endianness::Little {
            return Cow::Borrowed(bytes);
        }
        let mut bytes = bytes.to_vec();
        swap_bytes(&mut bytes, self.values.scalar_type().size_bytes());
        Cow::Owned(bytes)
    }

    /// The three steps from a point to its neighbours, and the first point, in world units.
    pub(crate) fn axes_and_origin(&self) -> ([DVec3; 3], DVec3) {
        let DAffine3 {
            matrix3,
            translation,
        } = self.grid.world_from_index();
        (
            [matrix3.x_axis, matrix3.y_axis, matrix3.z_axis],
            translation,
        )
    }

    /// What a format without any placement loses.
    pub(crate) fn lost_placement(&self, format: &str) -> Saved {
        if self.grid.world_from_index() == DAffine3::IDENTITY {
            return Vec::new();
        }
        vec![format!(
            "{format} files hold no spacing, origin or orientation; they were left out"
        )]
    }
}

/// A writer that holds grid and fields whole.
type WholeWriter = fn(&Path, &Dataset, &vtk::WriteOptions) -> Result<(), IoError>;

/// The formats that hold a whole dataset, by extension.
const WHOLE_WRITERS: &[(&str, WholeWriter)] = &[
    ("vti", vtk::write_vti),
    ("vtr", vtk::write_vtr),
    ("vts", vtk::write_vts),
    ("vtu", vtk::write_vtu),
];

/// What of the arrays that belong to neither points nor cells is lost: all.
fn lost_field_data(dataset: &Dataset) -> Saved {
    match dataset.field_data() {
        [] => Saved::new(),
        names => vec![format!(
            "arrays of the whole data set (field data) are left out: {}",
            names.join(", ")
        )],
    }
}

/// What VTK XML files lose of the meaning of coordinates.
fn lost_frame(dataset: &Dataset) -> Saved {
    let frame = dataset.frame().letters();
    let frame = frame.map(|frame| {
        format!("VTK files do not say in which anatomical frame coordinates are; these are {frame}")
    });
    frame.into_iter().collect()
}

/// Writes a dataset in the format of the path's extension: all of it as `.vti`, `.vtr`, `.vts` or `.vtu`,
/// one field as `.npy`, `.nrrd`, `.mha` or `.raw`. Returns what that format could not hold.
///
/// # Errors
/// [`IoError`] if the extension is unknown, the data does not fit the format, or the file cannot be
/// written; then the target stays as it was.
pub fn save(
    path: impl AsRef<Path>,
    dataset: &Dataset,
    options: &WriteOptions,
) -> Result<Saved, IoError> {
    let path = path.as_ref();
    let fail = |p: Problem| p.in_file(path);
    let extension = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    if let Some((_, write)) = WHOLE_WRITERS.iter().find(|(e, _)| *e == extension) {
        let encoding = if options.compress {
            vtk::WriteEncoding::Zlib
        } else {
            vtk::WriteEncoding::Raw
        };
        write(path, dataset, &vtk::WriteOptions { encoding })?;
        return Ok([lost_frame(dataset), lost_field_data(dataset)].concat());
    }
    let format = WRITERS
        .iter()
        .find(|f| f.extensions.contains(&extension.as_str()))
        .ok_or_else(|| {
            let mut known: Vec<String> = WRITERS
                .iter()
                .map(|f| format!("{} (.{})", f.name, f.extensions.join(", .")))
                .collect();
            known.push("VTK XML (.vti, .vtr, .vts, .vtu)".to_owned());
            let what = match extension.as_str() {
                "" => "writing to a name without an ending".to_owned(),
                extension => format!("writing `.{extension}` files"),
            };
            fail(Problem::unsupported_but(
                what,
                format!("vacua writes {}", known.join(", ")),
            ))
        })?;
    let Geometry::Uniform(grid) = &**dataset.geometry() else {
        return Err(fail(Problem::unsupported(format!(
            "{} points and cells in a {} file",
            dataset.geometry().kind(),
            format.name
        ))));
    };
    let field = dataset.field(&options.field).map_err(|e| fail(e.into()))?;
    if field.association() == Association::Cell {
        return Err(fail(Problem::unsupported(format!(
            "cell data (field `{}`) in a {} file, whose values are on points,",
            field.name(),
            format.name
        ))));
    }
    let values = field
        .load()
        .map_err(|e| fail(vacua_volume::DatasetError::from(e).into()))?;
    let voxels = Voxels {
        grid,
        frame: dataset.frame(),
        values,
        compress: options.compress,
    };
    let lost = (format.write)(path, &voxels)?;
    Ok([lost, lost_field_data(dataset)].concat())
}
