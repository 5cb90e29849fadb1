//! Several devices in one host that share every picture: each holds the whole volume, and makes bands
//! of rows that are dealt out in turn.

use std::sync::Arc;
use std::time::Instant;

use vacua_render::{Frame, RenderError, RenderReport, RenderSettings, Renderer, Rendering, Scene};

use crate::error::GpuError;
use crate::frame::make_room;
use crate::renderer::{GpuOptions, GpuRenderer, Share};
use crate::vulkan::{DeviceChoice, Instance};

/// A renderer on one device or on several.
///
/// Which skipping method is fastest is measured on the first; pictures are the same bits on devices of
/// one kind, whatever their number.
pub struct GpuGroup {
    members: Vec<GpuRenderer>,
}

impl GpuGroup {
    /// A renderer on the devices of choice: one, or with [`DeviceChoice::All`] all that can render.
    ///
    /// # Errors
    /// [`GpuError`] saying why there is none.
    pub fn new(choice: DeviceChoice) -> Result<Self, GpuError> {
        let instance = Instance::new(false)?;
        let choices = instance.resolve(choice)?;
        Self::with_devices(&instance, &choices, GpuOptions::default())
    }

    /// A renderer on devices of an instance; the same one may be among them several times.
    ///
    /// # Errors
    /// As [`GpuGroup::new`].
    pub fn with_devices(
        instance: &Arc<Instance>,
        choices: &[DeviceChoice],
        options: GpuOptions,
    ) -> Result<Self, GpuError> {
        let mut members = Vec::with_capacity(choices.len());
        for &choice in choices {
            members.push(GpuRenderer::with_options(instance, choice, options)?);
        }
        if members.is_empty() {
            return Err(GpuError::NoDevice {
                refused: Vec::new(),
            });
        }
        let count = members.len() as u32;
        for (index, member) in members.iter_mut().enumerate() {
            member.set_share(Share {
                count,
                index: index as u32,
            });
        }
        Ok(Self { members })
    }

    /// The renderers of the devices, each of a part of the picture.
    pub fn members(&self) -> &[GpuRenderer] {
        &self.members
    }

    /// The renderers of the devices, to be set up.
    pub fn members_mut(&mut self) -> &mut [GpuRenderer] {
        &mut self.members
    }

    /// Renders one picture into the memory of an earlier one, of whatever size.
    ///
    /// # Errors
    /// As [`Renderer::render`]; what the frame then holds is undefined.
    pub fn render_into(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        frame: &mut Frame,
    ) -> Result<RenderReport, RenderError> {
        Ok(self.make(scene, settings, frame)?)
    }

    fn make(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
        frame: &mut Frame,
    ) -> Result<RenderReport, GpuError> {
        let reports = each(&mut self.members, |member| member.begin(scene, settings))?;
        let mut report = slowest(reports);
        let plan = match self.members.first_mut() {
            Some(first) => first.plan(scene, settings, &mut report)?,
            None => {
                return Err(GpuError::Render(RenderError::Size {
                    width: settings.width,
                    height: settings.height,
                }));
            }
        };
        let start = Instant::now();
        let members = &mut self.members;
        let (drawn, ()) = rayon::join(
            || each(members, |member| member.draw(scene, settings, plan)),
            || make_room(frame, settings.width, settings.height),
        );
        drawn?;
        for member in &self.members {
            member.fetch(frame);
        }
        report.frame_secs = start.elapsed().as_secs_f64();
        if let Some(first) = self.members.first_mut() {
            first.finish(plan, &mut report);
        }
        Ok(report)
    }
}

impl Renderer for GpuGroup {
    fn render(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<Rendering, RenderError> {
        let mut frame = Frame::empty(0, 0);
        let report = self.make(scene, settings, &mut frame)?;
        Ok(Rendering { frame, report })
    }
}

/// Does something with every member at once; the first error, if there is one.
fn each<T: Send>(
    members: &mut [GpuRenderer],
    work: impl Fn(&mut GpuRenderer) -> Result<T, GpuError> + Sync,
) -> Result<Vec<T>, GpuError> {
    if let [only] = members {
        return Ok(vec![work(only)?]);
    }
    std::thread::scope(|scope| {
        let work = &work;
        let threads: Vec<_> = members
            .iter_mut()
            .map(|member| scope.spawn(move || work(member)))
            .collect();
        let results = threads.into_iter().map(|thread| match thread.join() {
            Ok(result) => result,
            Err(panic) => std::panic::resume_unwind(panic),
        });
        results.collect()
    })
}

/// The report of the device that took longest to take the volume.
fn slowest(reports: Vec<RenderReport>) -> RenderReport {
    let slower =
        |a: RenderReport, b: RenderReport| if b.volume_secs > a.volume_secs { b } else { a };
    reports.into_iter().reduce(slower).unwrap_or_default()
}
