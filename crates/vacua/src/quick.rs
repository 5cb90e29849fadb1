//! The short way from a file to a picture: a scene that fills in what is not said from the data, a
//! renderer for the device at hand, and frames that know how to be saved.

use std::ops::Deref;
use std::path::Path;
use std::sync::OnceLock;

use vacua_io::IoError;
use vacua_io::picture::{Picture, write_picture};
use vacua_pack::PackedVolumeError;
use vacua_render::{
    Camera, ClipPlane, RenderError, RenderReport, RenderSettings, Renderer as _, SceneData,
};
use vacua_volume::{
    Bounds, ComponentChoice, DatasetError, FieldChoice, StyleError, TransferFunction, TransferStyle,
};

use crate::blank::explain_blank;
use crate::content::Content;
use crate::device::{Backend, Device};

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The dataset has not what was asked for.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The look does not fit the data.
    #[error(transparent)]
    Style(#[from] StyleError),
    /// The picture cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A `.vacua` file has not what was asked for.
    #[error(transparent)]
    Packed(PackedVolumeError),
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] IoError),
}

impl From<PackedVolumeError> for Error {
    fn from(error: PackedVolumeError) -> Self {
        match error {
            PackedVolumeError::Choice(error) => Self::Dataset(error),
            PackedVolumeError::Io(error) => Self::Io(error),
            other => Self::Packed(other),
        }
    }
}

/// What values look like: settled, or a style that the data completes.
#[derive(Clone, Debug)]
pub enum Look {
    /// A settled transfer function.
    Function(TransferFunction),
    /// To be completed from the data.
    Style(TransferStyle),
}

impl From<TransferFunction> for Look {
    fn from(function: TransferFunction) -> Self {
        Self::Function(function)
    }
}

impl From<TransferStyle> for Look {
    fn from(style: TransferStyle) -> Self {
        Self::Style(style)
    }
}

/// Data, how it looks and from where, with defaults that show something.
#[derive(Clone, Debug)]
pub struct Scene {
    content: Content,
    field: FieldChoice,
    component: ComponentChoice,
    look: Look,
    camera: Camera,
    clip_planes: Vec<ClipPlane>,
    region_of_interest: Option<Bounds>,
    /// The chosen field, loaded once so that renderers keep what they built for it.
    data: OnceLock<SceneData>,
}

impl Scene {
    /// A scene of a file's content or one field, in the default look, seen from the front right.
    pub fn new(content: impl Into<Content>) -> Self {
        Self {
            content: content.into(),
            field: FieldChoice::Only,
            component: ComponentChoice::Auto,
            look: Look::Style(TransferStyle::default()),
            camera: Camera::orbit(30.0, 20.0),
            clip_planes: Vec::new(),
            region_of_interest: None,
            data: OnceLock::new(),
        }
    }

    /// Shows the field of this name; a dataset with one field needs no choice.
    pub fn field(mut self, name: &str) -> Self {
        self.field = FieldChoice::Name(name.to_owned());
        self.data = OnceLock::new();
        self
    }

    /// Shows one component of a field with several; its magnitude if not said.
    pub fn component(mut self, component: ComponentChoice) -> Self {
        self.component = component;
        self.data = OnceLock::new();
        self
    }

    /// What values look like: a [`TransferFunction`], or a [`TransferStyle`] that the data completes.
    pub fn transfer_function(mut self, look: impl Into<Look>) -> Self {
        self.look = look.into();
        self
    }

    /// The point of view.
    pub fn camera(mut self, camera: Camera) -> Self {
        self.camera = camera;
        self
    }

    /// Cuts away one side of a plane.
    pub fn clip(mut self, plane: ClipPlane) -> Self {
        self.clip_planes.push(plane);
        self
    }

    /// Cuts away everything outside a world box.
    pub fn region_of_interest(mut self, bounds: Bounds) -> Self {
        self.region_of_interest = Some(bounds);
        self
    }

    /// The chosen field, loaded at the first call.
    ///
    /// # Errors
    /// [`Error::Dataset`] if there is no such field, or several and no choice; [`Error::Dataset`] or
    /// [`Error::Io`] if it cannot be read.
    pub fn data(&self) -> Result<&SceneData, Error> {
        if let Some(data) = self.data.get() {
            return Ok(data);
        }
        let data = self.content.data(&self.field, self.component)?;
        Ok(self.data.get_or_init(|| data))
    }

    /// The scene with everything settled, as renderers take it.
    ///
    /// # Errors
    /// [`Error::Dataset`] or [`Error::Style`] if the data has not what was asked for.
    pub fn settled(&self) -> Result<vacua_render::Scene, Error> {
        let data = self.data()?;
        let function = match &self.look {
            Look::Function(function) => function.clone(),
            Look::Style(style) => style.resolve_for(&data.typical_scalars(), data.bounds())?,
        };
        let mut scene = vacua_render::Scene::new(data.clone(), function).camera(self.camera);
        scene.clip_planes.clone_from(&self.clip_planes);
        scene.region_of_interest = self.region_of_interest;
        Ok(scene)
    }
}

/// A renderer for a device, with default settings.
///
/// # Errors
/// [`Error::Render`] if the device cannot be used.
pub fn renderer(device: Device) -> Result<Renderer, Error> {
    Ok(Renderer {
        inner: Backend::new(device, None)?,
        settings: RenderSettings::default(),
    })
}

/// Renders scenes, and keeps between frames what it built for them.
pub struct Renderer {
    inner: Backend,
    settings: RenderSettings,
}

impl Renderer {
    /// Renders with other settings: size, step, skipping method …
    pub fn with_settings(mut self, settings: RenderSettings) -> Self {
        self.settings = settings;
        self
    }

    /// Renders one picture.
    ///
    /// # Errors
    /// [`Error`] naming what of the scene or the settings makes no sense.
    pub fn render(&mut self, scene: &Scene) -> Result<Frame, Error> {
        let rendering = self.inner.render(&scene.settled()?, &self.settings)?;
        Ok(Frame {
            frame: rendering.frame,
            report: rendering.report,
            settings: self.settings.clone(),
        })
    }
}

/// A finished picture: its pixels ([`vacua_render::Frame`]), and how it came about.
#[derive(Clone, Debug)]
pub struct Frame {
    frame: vacua_render::Frame,
    report: RenderReport,
    settings: RenderSettings,
}

impl Deref for Frame {
    type Target = vacua_render::Frame;

    fn deref(&self) -> &Self::Target {
        &self.frame
    }
}

impl Frame {
    /// What was built and used for this picture.
    pub fn report(&self) -> &RenderReport {
        &self.report
    }

    /// Saves the picture: `.png` over black, `.exr` with linear RGBA and depth.
    ///
    /// # Errors
    /// [`Error::Io`] for another ending, or if the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        self.save_over(path, Some([0.0; 3]))
    }

    /// Saves the picture, a `.png` over a background (linear-light red, green, blue) or with its
    /// alpha.
    ///
    /// # Errors
    /// [`Error::Io`] for another ending, or if the file cannot be written.
    pub fn save_over(
        &self,
        path: impl AsRef<Path>,
        background: Option<[f32; 3]>,
    ) -> Result<(), Error> {
        let picture = Picture {
            width: self.frame.width,
            height: self.frame.height,
            rgba: &self.frame.rgba,
            depth: Some(&self.frame.depth),
            cost: None,
        };
        Ok(write_picture(path.as_ref(), &picture, background)?)
    }

    /// Why the picture shows nothing; `None` if it shows something.
    ///
    /// # Errors
    /// As [`Scene::settled`].
    pub fn explain_blank(&self, scene: &Scene) -> Result<Option<String>, Error> {
        Ok(explain_blank(
            &scene.settled()?,
            &self.settings,
            &self.frame,
        ))
    }
}
