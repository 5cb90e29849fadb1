//! Pictures by several devices: how much faster than by one.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use vacua_gpu::{GpuGroup, GpuOptions as RendererOptions, Instance, Timings};
use vacua_render::{RenderSettings, Renderer, Scene, SkipMethod};

use crate::error::BenchError;
use crate::gpu::GpuOptions;
use crate::timing::median;

/// One number of devices.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GroupRow {
    /// How many.
    pub devices: usize,
    /// How empty space was skipped.
    pub method: String,
    /// Median seconds of a frame as a caller sees it, the picture on the host in the memory of the one
    /// before.
    pub frame_secs: f64,
    /// Median seconds of the march on the device that took longest.
    pub march_secs: f64,
    /// Whether the picture is that of one device, to the bit.
    pub is_exact: bool,
}

/// Measures a scene without skipping and by `grid`, on 1, 2, 4 … devices.
pub(crate) fn measure(scene: &Scene, options: &GpuOptions) -> Result<Vec<GroupRow>, BenchError> {
    let instance = Instance::new(false)?;
    let choices = instance.resolve(options.device)?;
    let mut counts: Vec<usize> = (0..)
        .map(|i| 1 << i)
        .take_while(|&n| n < choices.len())
        .collect();
    counts.push(choices.len());
    let mut rows = Vec::new();
    let mut alone = Vec::new();
    for count in counts {
        let defaults = RendererOptions::default();
        let mut group = GpuGroup::with_devices(&instance, &choices[..count], defaults)?;
        for (m, method) in [SkipMethod::None, SkipMethod::Grid].into_iter().enumerate() {
            let settings = RenderSettings {
                width: options.size.0,
                height: options.size.1,
                skip: method,
                ..RenderSettings::default()
            };
            let mut frame = group.render(scene, &settings)?.frame;
            if count == 1 {
                alone.push(frame.rgba.clone());
            }
            let (mut frames, mut marches) = (Vec::new(), Vec::new());
            for _ in 0..options.repeats {
                let report = group.render_into(scene, &settings, &mut frame)?;
                frames.push(report.frame_secs);
                let march = Timings::rays_secs;
                let of_members = group.members().iter().map(|g| march(g.timings()));
                marches.push(of_members.fold(0.0, f64::max));
            }
            rows.push(GroupRow {
                devices: count,
                method: method.name().to_owned(),
                frame_secs: median(frames),
                march_secs: median(marches),
                is_exact: alone[m] == frame.rgba,
            });
        }
    }
    Ok(rows)
}

/// The table; nothing if nothing was measured.
pub(crate) fn markdown(rows: &[GroupRow]) -> String {
    let mut out = String::new();
    if rows.is_empty() {
        return out;
    }
    out.push_str(
        "## Several devices\n\n| devices | method | frame ms | march ms | times as fast | exact |\n\
         |---|---|---|---|---|---|\n",
    );
    for r in rows {
        let one = rows.iter().find(|o| o.devices == 1 && o.method == r.method);
        let times = one.map_or(1.0, |o| o.frame_secs / r.frame_secs);
        let _ = writeln!(
            out,
            "| {} | {} | {:.2} | {:.2} | {times:.2} | {} |",
            r.devices,
            r.method,
            1e3 * r.frame_secs,
            1e3 * r.march_secs,
            if r.is_exact { "yes" } else { "NO" },
        );
    }
    out.push('\n');
    out
}
