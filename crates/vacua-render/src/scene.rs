//! What is to be seen and how: the scene and the settings of its rendering.

use glam::DVec3;
use vacua_pack::DetailLevel;
use vacua_volume::{Bounds, TransferFunction};

use crate::camera::Camera;
use crate::data::SceneData;

/// Half of space: points with `(p − point) · normal >= 0` are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipPlane {
    /// A point on the plane, world space.
    pub point: DVec3,
    /// Points to the side that is kept; any length but zero.
    pub normal: DVec3,
}

/// A field, what its values look like, and from where.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What is seen.
    pub data: SceneData,
    /// What its values look like.
    pub transfer_function: TransferFunction,
    /// From where.
    pub camera: Camera,
    /// Only what lies on the kept side of all of these is seen.
    pub clip_planes: Vec<ClipPlane>,
    /// Only what lies in this world box is seen.
    pub region_of_interest: Option<Bounds>,
}

impl Scene {
    /// A scene with all of the data, seen from the front right.
    pub fn new(data: impl Into<SceneData>, transfer_function: TransferFunction) -> Self {
        Self {
            data: data.into(),
            transfer_function,
            camera: Camera::orbit(30.0, 20.0),
            clip_planes: Vec::new(),
            region_of_interest: None,
        }
    }

    /// Changes what values look like.
    pub fn transfer_function(mut self, transfer_function: TransferFunction) -> Self {
        self.transfer_function = transfer_function;
        self
    }

    /// Changes the point of view.
    pub fn camera(mut self, camera: Camera) -> Self {
        self.camera = camera;
        self
    }

    /// Cuts away one side of a plane.
    pub fn clip(mut self, plane: ClipPlane) -> Self {
        self.clip_planes.push(plane);
        self
    }

    /// Cuts away everything outside a box.
    pub fn region_of_interest(mut self, bounds: Bounds) -> Self {
        self.region_of_interest = Some(bounds);
        self
    }
}

/// How samples of a ray become a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Integrator {
    /// Front-to-back compositing of emission and extinction.
    #[default]
    March,
    /// The largest value along the ray, if it exceeds the lower end of the colour range.
    MaximumIntensity,
}

/// Whether surfaces are lit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shading {
    /// Colours as the transfer function gives them.
    #[default]
    None,
    /// Lit from the camera, with the gradient of the field as normal.
    Gradient,
}

/// How empty space is skipped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SkipMethod {
    /// By what a short measurement finds fastest.
    #[default]
    Auto,
    /// Not at all.
    None,
    /// A walk over the macrocell mask.
    Grid,
    /// Clustered proxy boxes.
    Boxes,
    /// The triangulated boundary of the active macrocells.
    Mesh,
}

impl SkipMethod {
    /// The word that `--skip` takes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::None => "none",
            Self::Grid => "grid",
            Self::Boxes => "boxes",
            Self::Mesh => "mesh",
        }
    }
}

/// Whether sample positions are jittered between pixels (interleaved sampling).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Jitter {
    /// On from two samples a pixel.
    #[default]
    Auto,
    /// On.
    On,
    /// Off.
    Off,
}

/// What is taken for the values of a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Detail {
    /// What boxes of this level say of what is in them ([`vacua_pack::detail`]): coarser and faster.
    /// Estimates have no gradient, so that surfaces are not lit.
    Level(DetailLevel),
    /// The values.
    #[default]
    Exact,
}

impl Detail {
    /// The word that `--lod` takes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Level(level) => level.name(),
            Self::Exact => "exact",
        }
    }
}

/// What is drawn over the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overlay {
    /// Nothing.
    #[default]
    None,
    /// The boundary of the active macrocells that face the camera.
    Boundary,
}

/// How a picture is made.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSettings {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Distance between samples, in cells.
    pub step: f64,
    /// What is taken for the values of a mesh; grids have no levels of detail.
    pub detail: Detail,
    /// How samples become a pixel.
    pub integrator: Integrator,
    /// Whether surfaces are lit.
    pub shading: Shading,
    /// How empty space is skipped.
    pub skip: SkipMethod,
    /// What is drawn over the picture; depth and counts of samples are those of the volume.
    pub overlay: Overlay,
    /// Cells a side of a macrocell; chosen by measurement, or 8, if not given.
    pub macrocell_side: Option<usize>,
    /// Rays a pixel: frames that are averaged.
    pub samples_per_pixel: u32,
    /// Number of the first of these frames; progressive rendering goes on where it stopped.
    pub first_frame: u32,
    /// Whether sample positions are jittered.
    pub jitter: Jitter,
    /// A ray ends when less than this part of the light behind it would come through; 0 never ends.
    pub termination: f32,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            width: 1024,
            height: 1024,
            step: 0.5,
            detail: Detail::Exact,
            integrator: Integrator::March,
            shading: Shading::None,
            skip: SkipMethod::Auto,
            overlay: Overlay::None,
            macrocell_side: None,
            samples_per_pixel: 1,
            first_frame: 0,
            jitter: Jitter::Auto,
            termination: 1.0 / 1024.0,
        }
    }
}
