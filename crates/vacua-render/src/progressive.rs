//! A slow picture that comes bit by bit: coarse levels of detail first, then the mean of more and more
//! exact frames.

use vacua_volume::Geometry;

use crate::accumulate::Accumulator;
use crate::cpu::{Renderer, Rendering};
use crate::data::SceneData;
use crate::error::RenderError;
use crate::scene::{Detail, Jitter, Overlay, RenderSettings, Scene, SkipMethod};

/// Levels that come before the values, the coarsest first. Leaves are left out: they take a good
/// part of the time of the values themselves.
const COARSE: [Detail; 2] = [
    Detail::Level(vacua_pack::DetailLevel::Submesh),
    Detail::Level(vacua_pack::DetailLevel::MultiLeaf),
];

/// The pictures of a scene on the way to the one that settings ask for: of a mesh first two at coarse
/// levels of detail, then, of everything, the mean of the first exact frame, of the first two, and so
/// on. The last is the picture that [`Renderer::render`] gives at once, to the bit.
pub struct Progressive<'a, R: ?Sized> {
    renderer: &'a mut R,
    scene: &'a Scene,
    settings: RenderSettings,
    next: Next,
    /// How many exact frames are rendered one by one; a picture with an overlay comes at once, since
    /// that is drawn over the mean.
    frames: u32,
    /// The exact frames so far.
    sum: Option<Accumulator>,
}

/// What comes next.
#[derive(Clone, Copy)]
enum Next {
    /// A coarse picture, by its place among [`COARSE`].
    Coarse(usize),
    /// A frame at the detail that was asked for, by its number among those of the picture.
    Frame(u32),
    /// Nothing.
    End,
}

impl<'a, R: Renderer + ?Sized> Progressive<'a, R> {
    /// Begins a picture.
    pub fn new(renderer: &'a mut R, scene: &'a Scene, settings: RenderSettings) -> Self {
        let is_mesh = match &scene.data {
            SceneData::Packed(_) => true,
            SceneData::Volume(volume) => matches!(
                &**volume.geometry(),
                Geometry::Unstructured(_) | Geometry::Curvilinear(_)
            ),
        };
        // What is coarse itself comes at once.
        let coarse_first = is_mesh && settings.detail == Detail::Exact && settings.first_frame == 0;
        let frames = match settings.overlay {
            Overlay::None => settings.samples_per_pixel.max(1),
            Overlay::Boundary => 1,
        };
        Self {
            renderer,
            scene,
            settings,
            frames,
            next: if coarse_first {
                Next::Coarse(0)
            } else {
                Next::Frame(0)
            },
            sum: None,
        }
    }

    /// Number of frames that are still to be rendered.
    pub fn remaining(&self) -> u32 {
        match self.next {
            Next::Coarse(place) => (COARSE.len() - place) as u32 + self.frames,
            Next::Frame(number) => self.frames - number,
            Next::End => 0,
        }
    }

    fn coarse(&mut self, place: usize) -> Result<Rendering, RenderError> {
        let settings = RenderSettings {
            detail: COARSE[place],
            samples_per_pixel: 1,
            // To measure which is fastest would take longer than to render.
            skip: match self.settings.skip {
                SkipMethod::Auto => SkipMethod::Grid,
                other => other,
            },
            ..self.settings.clone()
        };
        self.renderer.render(self.scene, &settings)
    }

    fn frame(&mut self, number: u32) -> Result<Rendering, RenderError> {
        let wanted = &self.settings;
        if self.frames == 1 {
            return self.renderer.render(self.scene, wanted);
        }
        let settings = RenderSettings {
            samples_per_pixel: 1,
            first_frame: wanted.first_frame.wrapping_add(number),
            // As for all of the frames together.
            jitter: match wanted.jitter {
                Jitter::Auto if wanted.samples_per_pixel > 1 || wanted.first_frame > 0 => {
                    Jitter::On
                }
                Jitter::Auto => Jitter::Off,
                other => other,
            },
            ..wanted.clone()
        };
        let rendering = self.renderer.render(self.scene, &settings)?;
        let sum = match self.sum.take() {
            None => Accumulator::new(rendering.frame),
            Some(mut sum) => {
                sum.add(&rendering.frame);
                sum
            }
        };
        let frame = sum.clone().mean();
        self.sum = Some(sum);
        Ok(Rendering { frame, ..rendering })
    }
}

impl<R: Renderer + ?Sized> Iterator for Progressive<'_, R> {
    type Item = Result<Rendering, RenderError>;

    /// The next picture; nothing after the last, or after an error.
    fn next(&mut self) -> Option<Self::Item> {
        let rendered = match self.next {
            Next::Coarse(place) => {
                self.next = match place + 1 {
                    end if end == COARSE.len() => Next::Frame(0),
                    more => Next::Coarse(more),
                };
                match self.coarse(place) {
                    // A device without levels of detail; should it fail, it will again.
                    Err(RenderError::Device(_)) => {
                        self.next = Next::Frame(0);
                        return self.next();
                    }
                    rendered => rendered,
                }
            }
            Next::Frame(number) => {
                self.next = match number + 1 {
                    end if end >= self.frames => Next::End,
                    more => Next::Frame(more),
                };
                self.frame(number)
            }
            Next::End => return None,
        };
        if rendered.is_err() {
            self.next = Next::End;
        }
        Some(rendered)
    }
}
