//! `auto`: which macrocell size is fastest on this device for this scene, or none, by measurement.
//!
//! Each candidate renders the picture once to settle and once to be timed by the device's clock; a
//! frame takes a few milliseconds where it pays. The choice is kept until the transfer function
//! changes.

use vacua_render::{RenderSettings, Scene, SkipMethod};

use super::{DEFAULT_SIDE, GpuRenderer, Plan};
use crate::error::GpuError;

/// Macrocell sides that are tried.
const SIDES: [usize; 2] = [16, 8];

/// Pictures of fewer pixels are not worth measuring.
const LEAST_PIXELS: usize = 1 << 18;

/// What a choice was made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wanted {
    side: Option<usize>,
    integrator: vacua_render::Integrator,
    shading: vacua_render::Shading,
    size: [usize; 2],
}

/// What was chosen, and why.
#[derive(Clone, Debug)]
pub(super) struct Choice {
    plan: Plan,
    reason: String,
}

impl GpuRenderer {
    /// The plan, its reason, and whether it was made just now.
    pub(super) fn choose(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<(Plan, String, bool), GpuError> {
        let wanted = Wanted {
            side: settings.macrocell_side,
            integrator: settings.integrator,
            shading: settings.shading,
            size: [settings.width, settings.height],
        };
        if let Some((_, choice)) = self.choice.as_ref().filter(|(w, _)| *w == wanted) {
            return Ok((choice.plan, choice.reason.clone(), false));
        }
        let choice = if settings.width * settings.height < LEAST_PIXELS {
            Choice {
                plan: Plan {
                    method: SkipMethod::Grid,
                    side: settings.macrocell_side.unwrap_or(DEFAULT_SIDE),
                },
                reason: "the picture is too small to measure".to_owned(),
            }
        } else {
            self.measure(scene, settings)?
        };
        let (plan, reason) = (choice.plan, choice.reason.clone());
        self.choice = Some((wanted, choice));
        Ok((plan, reason, true))
    }

    fn measure(&mut self, scene: &Scene, settings: &RenderSettings) -> Result<Choice, GpuError> {
        let sides = match settings.macrocell_side {
            Some(side) => vec![side],
            None => SIDES.to_vec(),
        };
        let grid = |side| Plan {
            method: SkipMethod::Grid,
            side,
        };
        let mut plans: Vec<Plan> = sides.iter().copied().map(grid).collect();
        plans.push(Plan {
            method: SkipMethod::None,
            side: sides[0],
        });
        let mut best: Option<(f64, Plan)> = None;
        let mut times = Vec::new();
        for plan in plans {
            // More frames are to come, so that nothing is sent back.
            self.submit(scene, settings, plan, 0..1, 2)?;
            let secs = self.submit(scene, settings, plan, 0..1, 2)?.secs("march");
            times.push(match plan.method {
                SkipMethod::None => format!("none {:.2} ms", 1e3 * secs),
                method => format!("{} K={} {:.2} ms", method.name(), plan.side, 1e3 * secs),
            });
            if best.is_none_or(|(least, _)| secs < least) {
                best = Some((secs, plan));
            }
        }
        let plan = best.map_or(grid(DEFAULT_SIDE), |(_, plan)| plan);
        let reason = format!("fastest on the device: {}", times.join(", "));
        Ok(Choice { plan, reason })
    }
}
