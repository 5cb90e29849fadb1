//! The kinds of procedural volumes by name, and the function that makes them.

use std::fmt;
use std::str::FromStr;

use glam::DVec3;
use vacua_volume::{
    ArrayError, Association, DataArray, Dataset, DatasetError, Field, Geometry, GridError,
    MeshError, ScalarType, TransferFunction, TransferFunctionError, UniformGrid,
};

use crate::bench_scene::BenchScene;
use crate::fill::{fill, fill_f64, num_points, unit_scale};
use crate::linear;
use crate::shells::Shells;
use crate::standin::looks;
use crate::standin::{Blobs, Dns, Flower, Heptane, Llnl};

/// A kind of procedural volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// The benchmark scene: four thin spherical shells.
    Shells,
    /// The same value everywhere.
    Constant,
    /// A linear field on a uniform grid with different spacings.
    Linear,
    /// A linear field on a stretched rectilinear grid.
    LinearRectilinear,
    /// A linear field on a box twisted about its z axis.
    LinearTwist,
    /// A linear field on three quarters of a thick-walled pipe.
    LinearAnnulus,
    /// A plume, like paper A's HEPTANE.
    Heptane,
    /// Petals, like paper A's FLOWER.
    Flower,
    /// Turbulence, like paper A's DNS(4X).
    Dns,
    /// A mixing layer, like paper A's LLNL.
    Llnl,
    /// Noisy blobs with a dense core in a thin shell: the large benchmark scene.
    Blobs,
}

/// A name that is no [`Kind`].
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("unknown kind `{asked}`, expected one of {}", Kind::ALL.map(Kind::name).join(", "))]
pub struct UnknownKind {
    /// What was asked for.
    pub asked: String,
}

/// Why a procedural volume could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SynthError {
    /// A side without a cell.
    #[error("a volume needs at least 2 points a side, asked for {} × {} × {}", .points[0], .points[1], .points[2])]
    TooSmall {
        /// Points a side asked for.
        points: [usize; 3],
    },
    /// More than memory holds.
    #[error("there is no memory for {} × {} × {} points", .points[0], .points[1], .points[2])]
    TooLarge {
        /// Points a side asked for.
        points: [usize; 3],
    },
    /// A size that cannot be read.
    #[error("`{asked}` is no size, expected a number of points (256) or three (512x256x64)")]
    Size {
        /// What was asked for.
        asked: String,
    },
    /// The numbers make no grid.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// The values make no array.
    #[error(transparent)]
    Array(#[from] ArrayError),
    /// The cells make no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Geometry and values do not fit together.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The points make no transfer function.
    #[error(transparent)]
    TransferFunction(#[from] TransferFunctionError),
}

impl Kind {
    /// Every kind, in the order in which they are listed to people.
    pub const ALL: [Self; 11] = [
        Self::Shells,
        Self::Constant,
        Self::Linear,
        Self::LinearRectilinear,
        Self::LinearTwist,
        Self::LinearAnnulus,
        Self::Heptane,
        Self::Flower,
        Self::Dns,
        Self::Llnl,
        Self::Blobs,
    ];

    /// The name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Shells => "shells",
            Self::Constant => "constant",
            Self::Linear => "linear",
            Self::LinearRectilinear => "linear-rectilinear",
            Self::LinearTwist => "linear-twist",
            Self::LinearAnnulus => "linear-annulus",
            Self::Heptane => "heptane",
            Self::Flower => "flower",
            Self::Dns => "dns",
            Self::Llnl => "llnl",
            Self::Blobs => "blobs",
        }
    }

    /// Points a side if none are asked for: those of the data set it stands for.
    pub const fn default_points(self) -> [usize; 3] {
        match self {
            Self::Shells => [256; 3],
            Self::Heptane => [302; 3],
            Self::Flower | Self::Blobs => [1024; 3],
            Self::Dns => [2560, 1920, 384],
            Self::Llnl => [2048, 2048, 1920],
            Self::Constant
            | Self::Linear
            | Self::LinearRectilinear
            | Self::LinearTwist
            | Self::LinearAnnulus => [64; 3],
        }
    }

    /// Type of a number if none is asked for.
    pub const fn default_type(self) -> ScalarType {
        match self {
            Self::Heptane | Self::Flower | Self::Dns | Self::Llnl | Self::Blobs => ScalarType::U8,
            _ => ScalarType::F32,
        }
    }

    /// The transfer functions made for this kind when stored as `scalar_type`, by name; the first
    /// is the default, and opacities are per voxel. Active fractions hold for these.
    ///
    /// # Errors
    /// [`SynthError::TransferFunction`] never happens for the points in this crate.
    pub fn transfer_functions(
        self,
        scalar_type: ScalarType,
    ) -> Result<Vec<(&'static str, TransferFunction)>, SynthError> {
        let scale = unit_scale(scalar_type);
        Ok(match self {
            Self::Shells => vec![("default", BenchScene::transfer_function(scale)?)],
            kind => looks(kind, scale)?,
        })
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Kind {
    type Err = UnknownKind;

    fn from_str(name: &str) -> Result<Self, UnknownKind> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| UnknownKind {
                asked: name.to_owned(),
            })
    }
}

/// Reads points a side: `256` for a cube or `512x256x64`.
///
/// # Errors
/// [`SynthError::Size`] if the text is neither.
pub fn parse_size(text: &str) -> Result<[usize; 3], SynthError> {
    let error = || SynthError::Size {
        asked: text.to_owned(),
    };
    let numbers = text
        .split(['x', 'X', '×'])
        .map(|n| n.trim().parse::<usize>())
        .collect::<Result<Vec<_>, _>>()
        .map_err(|_| error())?;
    match numbers[..] {
        [n] => Ok([n; 3]),
        [x, y, z] => Ok([x, y, z]),
        _ => Err(error()),
    }
}

/// What to make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spec {
    /// Which volume.
    pub kind: Kind,
    /// Points a side.
    pub points: [usize; 3],
    /// Type of a number.
    pub scalar_type: ScalarType,
}

impl Spec {
    /// A kind at its default size and type.
    pub const fn new(kind: Kind) -> Self {
        Self {
            kind,
            points: kind.default_points(),
            scalar_type: kind.default_type(),
        }
    }

    /// The same with other points a side.
    pub const fn with_points(self, points: [usize; 3]) -> Self {
        Self { points, ..self }
    }

    /// The same with numbers of another type.
    pub const fn with_type(self, scalar_type: ScalarType) -> Self {
        Self {
            scalar_type,
            ..self
        }
    }
}

/// Makes a volume: one point field `scalars`, in parallel, the same bytes every time.
///
/// # Errors
/// [`SynthError`] if a side has fewer than two points or memory does not suffice.
pub fn generate(spec: &Spec) -> Result<Dataset, SynthError> {
    let Spec {
        kind,
        points,
        scalar_type,
    } = *spec;
    num_points(points)?;
    let values = match kind {
        Kind::Linear | Kind::LinearRectilinear | Kind::LinearTwist | Kind::LinearAnnulus => {
            return linear::generate(spec);
        }
        Kind::Constant => {
            let half = 0.5 * unit_scale(scalar_type);
            fill_f64(points, scalar_type, |_| half)?
        }
        Kind::Shells => fill(points, scalar_type, &Shells::new(points))?,
        Kind::Heptane => fill(points, scalar_type, &Heptane::new(points))?,
        Kind::Flower => fill(points, scalar_type, &Flower::new(points))?,
        Kind::Dns => fill(points, scalar_type, &Dns::new(points))?,
        Kind::Llnl => fill(points, scalar_type, &Llnl::new(points))?,
        Kind::Blobs => fill(points, scalar_type, &Blobs::new(points))?,
    };
    let grid = UniformGrid::new(points, DVec3::ZERO, DVec3::ONE)?;
    dataset(Geometry::Uniform(grid), values)
}

/// A data set of one point field.
pub(crate) fn dataset(geometry: Geometry, values: DataArray) -> Result<Dataset, SynthError> {
    let field = Field::new("scalars", Association::Point, values);
    Ok(Dataset::new(geometry, vec![field])?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_sizes_are_read() {
        for kind in Kind::ALL {
            assert_eq!(kind.name().parse(), Ok(kind));
        }
        let error = "sphere".parse::<Kind>().expect_err("no such kind");
        assert!(error.to_string().contains("linear-twist"));
        assert_eq!(parse_size("12").expect("a cube"), [12; 3]);
        assert_eq!(parse_size("3x4X5").expect("a box"), [3, 4, 5]);
        for bad in ["", "3x4", "x", "-3", "1x2x3x4", "99999999999999999999"] {
            assert!(
                matches!(parse_size(bad), Err(SynthError::Size { .. })),
                "{bad}"
            );
        }
    }

    #[test]
    fn every_kind_comes_in_every_type() {
        for kind in Kind::ALL {
            for scalar_type in ScalarType::ALL {
                let spec = Spec::new(kind)
                    .with_points([20, 17, 13])
                    .with_type(scalar_type);
                let made = generate(&spec).expect("small");
                let values = made.fields()[0].load().expect("in memory").clone();
                assert_eq!(values.scalar_type(), scalar_type);
                let range = values.range(0).expect("finite");
                assert!(range.lo >= 0.0 && range.hi <= unit_scale(scalar_type) * 1.000_001);
                assert_eq!(made.geometry().points(), [20, 17, 13]);
                assert!(
                    !kind
                        .transfer_functions(scalar_type)
                        .expect("valid")
                        .is_empty()
                );
            }
        }
    }

    #[test]
    fn nonsense_sizes_are_errors() {
        for kind in Kind::ALL {
            let spec = Spec::new(kind).with_points([1, 5, 5]);
            assert!(matches!(generate(&spec), Err(SynthError::TooSmall { .. })));
            let spec = Spec::new(kind).with_points([usize::MAX, usize::MAX, 2]);
            assert!(matches!(generate(&spec), Err(SynthError::TooLarge { .. })));
        }
    }

    #[test]
    fn threads_change_nothing() {
        let spec = Spec::new(Kind::Blobs).with_points([40, 41, 42]);
        let bytes = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads")
                .install(|| generate(&spec).expect("small"))
                .fields()[0]
                .load()
                .expect("in memory")
                .bytes()
                .to_vec()
        };
        assert_eq!(bytes(1), bytes(3));
    }
}
