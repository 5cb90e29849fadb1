//! `auto`: which method and macrocell size is fastest on this device for this scene, by measurement.
//!
//! Each candidate renders the picture once to settle and once to be timed by the device's clock; a
//! frame takes a few milliseconds where it pays. Those that come near the best are timed again, one right
//! after the other: a device's clock falls while shaders are compiled. A choice survives edits of the
//! transfer function as long as about as much is seen.

use vacua_render::{RenderReport, RenderSettings, Scene, SkipMethod};

use super::{DEFAULT_SIDE, GpuRenderer, Plan, Tracer};
use crate::error::GpuError;

/// Macrocell sides that are tried.
const SIDES: [usize; 2] = [16, 8];

/// A side that is tried by the walk where the finer of those was the faster, and most macrocells of it:
/// beyond, they take more memory and time after an edit than frames are worth.
const FINE_SIDE: usize = 4;
const MOST_FINE: usize = 1 << 25;

/// The same over packed meshes, whose lattice cubes hold a few cells each.
const MESH_SIDES: [usize; 3] = [8, 4, 2];

/// Where a smaller part of the macrocells is active, skipping is faster than not skipping.
const CROWDED: f64 = 0.3;

/// Macrocells that are clustered into boxes just to measure, at most: it is done on the host.
const MOST_CLUSTERED: usize = 1 << 19;

/// How much slower than the best a candidate may be to be timed again, or tried with finer macrocells.
const NEAR: f64 = 3.0;

/// Change of the active part, as a factor, that makes a choice doubtful.
const DOUBTFUL: f64 = 1.5;

/// What a choice was made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wanted {
    side: Option<usize>,
    integrator: vacua_render::Integrator,
    shading: vacua_render::Shading,
    size: [usize; 2],
    tracer: Option<Tracer>,
}

/// What was chosen, and why.
#[derive(Clone, Debug)]
pub(super) struct Choice {
    plan: Plan,
    reason: String,
    /// Part of the macrocells that was active; unknown before the first picture.
    active: Option<f64>,
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
            tracer: self.options.tracer,
        };
        if let Some((_, choice)) = self.choice.as_ref().filter(|(w, _)| *w == wanted) {
            // What a picture without skipping shows of the new transfer function is not known.
            if self.choice_is_reviewed || choice.plan.method != SkipMethod::None {
                return Ok((choice.plan, choice.reason.clone(), false));
            }
        }
        let choice = if settings.width * settings.height < self.options.least_pixels {
            Choice {
                plan: walk(settings.macrocell_side.unwrap_or(DEFAULT_SIDE)),
                reason: "the picture is too small to measure".to_owned(),
                active: None,
            }
        } else {
            self.measure(scene, settings)?
        };
        let (plan, reason) = (choice.plan, choice.reason.clone());
        self.choice = Some((wanted, choice));
        self.choice_is_reviewed = true;
        Ok((plan, reason, true))
    }

    /// Drops a choice that was made for a transfer function with which much more or less is seen.
    pub(super) fn review_choice(&mut self, report: &RenderReport) {
        let Some((_, choice)) = &mut self.choice else {
            return;
        };
        let is_its_own = (report.method, report.macrocell_side)
            == (choice.plan.method, choice.plan.side)
            && report.num_macrocells > 0;
        if !is_its_own {
            return;
        }
        let part = (report.num_active as f64 / report.num_macrocells as f64).max(1e-6);
        let before = *choice.active.get_or_insert(part);
        let is_doubtful = part > DOUBTFUL * before || before > DOUBTFUL * part;
        self.choice_is_reviewed = !is_doubtful;
        if is_doubtful {
            self.choice = None;
        }
    }

    fn measure(&mut self, scene: &Scene, settings: &RenderSettings) -> Result<Choice, GpuError> {
        let sides = match settings.macrocell_side {
            Some(side) => vec![side],
            None if self.mesh.is_some() => MESH_SIDES.to_vec(),
            None => SIDES.to_vec(),
        };
        let mut contest = Contest::default();
        for &side in &sides {
            contest.enter(self, scene, settings, walk(side))?;
        }
        let num = |r: &Self, side| r.macrocells.get(&side).map_or(1, |m| m.len() as usize);
        let part = self.num_active as f64 / num(self, sides[sides.len() - 1]) as f64;
        if self.mesh.is_none() && settings.macrocell_side.is_none() && self.wants_fine(&contest) {
            contest.enter(self, scene, settings, walk(FINE_SIDE))?;
        }
        let tracers = match self.options.tracer {
            Some(tracer) => vec![tracer],
            None => self.tracers(),
        };
        let mesh = |side, tracer| Plan {
            method: SkipMethod::Mesh,
            side,
            tracer: Some(tracer),
        };
        for tracer in tracers {
            // Where the coarser boundary is no match for the walk, a finer one is none either.
            for &side in &sides {
                let secs = contest.enter(self, scene, settings, mesh(side, tracer))?;
                if secs > NEAR * contest.least() {
                    break;
                }
            }
        }
        let is_small = num(self, sides[0]) <= MOST_CLUSTERED;
        if is_small
            && self.mesh.is_none()
            && self.device.info().has_ray_tracing()
            && contest.rays_are_near()
        {
            let boxes = Plan {
                method: SkipMethod::Boxes,
                ..walk(sides[0])
            };
            contest.enter(self, scene, settings, boxes)?;
        }
        if part > CROWDED {
            let none = Plan {
                method: SkipMethod::None,
                ..walk(sides[0])
            };
            contest.enter(self, scene, settings, none)?;
        }
        contest.end(self, scene, settings)?;
        Ok(contest.choice())
    }
}

impl GpuRenderer {
    /// Whether macrocells of the fine side are worth trying.
    fn wants_fine(&self, contest: &Contest) -> bool {
        let finest = SIDES[SIDES.len() - 1];
        let is_fastest = contest.best().is_some_and(|(plan, _)| plan.side == finest);
        let finer = (finest / FINE_SIDE).pow(3);
        let num = self.macrocells.get(&finest).map_or(0, |m| m.len() as usize);
        is_fastest && num.saturating_mul(finer) <= MOST_FINE
    }
}

/// The walk over the distance map.
fn walk(side: usize) -> Plan {
    Plan {
        method: SkipMethod::Grid,
        side,
        tracer: None,
    }
}

/// Whether others may do where this one cannot; without the walk nothing would be left.
fn is_forgiven(error: &GpuError, plan: Plan) -> bool {
    let is_dispensable = plan != walk(plan.side) || plan.side == FINE_SIDE;
    is_dispensable
        && matches!(
            error,
            GpuError::Unsupported { .. } | GpuError::Memory { .. }
        )
}

/// Seconds that a frame's rays take on the device, after one frame to settle.
fn time(
    renderer: &mut GpuRenderer,
    scene: &Scene,
    settings: &RenderSettings,
    plan: Plan,
) -> Result<f64, GpuError> {
    // More frames are to come, so that nothing is sent back.
    let mut submit = || renderer.submit(scene, settings, plan, 0..1, 2);
    submit()?;
    Ok(submit()?.rays_secs())
}

/// Candidates and their times.
#[derive(Default)]
struct Contest {
    entries: Vec<(Plan, f64)>,
}

impl Contest {
    /// Times a candidate, in seconds; what the device cannot do, or has no memory for, takes for ever.
    fn enter(
        &mut self,
        renderer: &mut GpuRenderer,
        scene: &Scene,
        settings: &RenderSettings,
        plan: Plan,
    ) -> Result<f64, GpuError> {
        match time(renderer, scene, settings, plan) {
            Ok(secs) => {
                self.entries.push((plan, secs));
                Ok(secs)
            }
            Err(error) if is_forgiven(&error, plan) => Ok(f64::INFINITY),
            Err(other) => Err(other),
        }
    }

    /// Times those that are near the best again, once everything is compiled.
    fn end(
        &mut self,
        renderer: &mut GpuRenderer,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<(), GpuError> {
        let most = NEAR * self.least();
        let near: Vec<_> = self.entries.iter_mut().filter(|e| e.1 <= most).collect();
        if near.len() > 1 {
            for (plan, secs) in near {
                *secs = match time(renderer, scene, settings, *plan) {
                    Err(error) if is_forgiven(&error, *plan) => f64::INFINITY,
                    timed => timed?,
                };
            }
        }
        Ok(())
    }

    fn best(&self) -> Option<&(Plan, f64)> {
        self.entries.iter().min_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn least(&self) -> f64 {
        self.best().map_or(f64::INFINITY, |(_, secs)| *secs)
    }

    /// Whether tracing the boundary is not far behind.
    fn rays_are_near(&self) -> bool {
        let mut traced = self
            .entries
            .iter()
            .filter(|(p, _)| p.method == SkipMethod::Mesh);
        traced.any(|(_, secs)| *secs <= NEAR * self.least())
    }

    fn choice(&self) -> Choice {
        let name = |plan: &Plan| match (plan.method, plan.tracer) {
            (SkipMethod::None, _) => "none".to_owned(),
            (SkipMethod::Mesh, Some(Tracer::Query)) => format!("mesh by queries K={}", plan.side),
            (SkipMethod::Mesh, Some(Tracer::Packets)) => format!("mesh by packets K={}", plan.side),
            (method, _) => format!("{} K={}", method.name(), plan.side),
        };
        let times = self.entries.iter();
        let times: Vec<String> = times
            .map(|(plan, secs)| format!("{} {:.2} ms", name(plan), 1e3 * secs))
            .collect();
        Choice {
            plan: self.best().map_or(walk(DEFAULT_SIDE), |(plan, _)| *plan),
            reason: format!("fastest on the device: {}", times.join(", ")),
            active: None,
        }
    }
}
