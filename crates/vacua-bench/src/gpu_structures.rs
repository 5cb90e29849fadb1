//! How acceleration structures over the boundary are built (paper A §4.2.3 and §6): for tracing or for
//! building, compacted or not, moved or built anew.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use vacua_gpu::{GpuRenderer, Preference, StructureOptions, Timings};
use vacua_render::{RenderSettings, Renderer, Scene};

use crate::error::BenchError;
use crate::gpu::GpuOptions;
use crate::timing::median;
use crate::volumes;

/// One way to build.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StructureRow {
    /// Its name.
    pub name: String,
    /// Cells a side of a macrocell.
    pub side: usize,
    /// Triangles.
    pub triangles: usize,
    /// Bytes of the structure over the triangles, and of all that rays are traced against.
    pub bytes: [u64; 2],
    /// Median seconds on the device after an edit: counting faces and writing triangles.
    pub outline_secs: f64,
    /// The structure over the triangles, built or moved.
    pub lower_secs: f64,
    /// Its copy to where it takes less memory.
    pub compact_secs: f64,
    /// The structure above.
    pub upper_secs: f64,
    /// The march.
    pub march_secs: f64,
}

const WAYS: [(&str, StructureOptions); 5] = [
    ("fast trace", options(Preference::FastTrace, false, false)),
    (
        "fast trace, compacted",
        options(Preference::FastTrace, true, false),
    ),
    ("fast build", options(Preference::FastBuild, false, false)),
    (
        "fast trace, moved",
        options(Preference::FastTrace, false, true),
    ),
    (
        "fast build, moved",
        options(Preference::FastBuild, false, true),
    ),
];

const fn options(preference: Preference, compact: bool, refit: bool) -> StructureOptions {
    StructureOptions {
        preference,
        compact,
        refit,
    }
}

/// Measures every way at every macrocell size. Edits alternate between the scene's transfer function
/// and one whose opacities lie a little higher, so that triangles move.
pub(crate) fn measure(
    gpu: &mut GpuRenderer,
    scene: &Scene,
    settings: &RenderSettings,
    options: &GpuOptions,
) -> Result<Vec<StructureRow>, BenchError> {
    let mut rows = Vec::new();
    if !gpu.device().info().has_ray_tracing() {
        return Ok(rows);
    }
    let moved = volumes::moved(&scene.transfer_function, 0.01)?;
    let scenes =
        [moved, scene.transfer_function.clone()].map(|look| scene.clone().transfer_function(look));
    for &side in &options.sides {
        let settings = RenderSettings {
            macrocell_side: Some(side),
            ..settings.clone()
        };
        for (name, way) in WAYS {
            gpu.set_structures(way);
            let mut found: Vec<Timings> = Vec::new();
            for i in 0..2 * options.repeats + 2 {
                gpu.render(&scenes[i % 2], &settings)?;
                // The first two build everything; of the others, those of the scene itself count.
                if i > 2 && i % 2 == 1 {
                    found.push(gpu.timings().clone());
                }
            }
            let of = |names: &[&str]| {
                let sum = |t: &Timings| names.iter().map(|name| t.secs(name)).sum();
                median(found.iter().map(sum).collect())
            };
            let [all, lower] = gpu.outline_bytes();
            rows.push(StructureRow {
                name: name.to_owned(),
                side,
                triangles: 2 * gpu.num_outlined(),
                bytes: [lower, all],
                outline_secs: of(&["faces", "triangles"]),
                lower_secs: of(&["blas", "refit"]),
                compact_secs: of(&["compact"]),
                upper_secs: of(&["tlas"]),
                march_secs: of(&["find", "march"]),
            });
        }
        gpu.set_structures(StructureOptions::default());
    }
    Ok(rows)
}

/// The table; nothing if nothing was measured.
pub(crate) fn markdown(rows: &[StructureRow]) -> String {
    let mut out = String::new();
    if rows.is_empty() {
        return out;
    }
    out.push_str(
        "| built for | K | triangles | BLAS KiB | all KiB | triangles ms | BLAS ms | compaction ms \
         | TLAS ms | march ms |\n|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for r in rows {
        let [lower, all] = r.bytes.map(|b| b as f64 / 1024.0);
        let _ = writeln!(
            out,
            "| {} | {} | {} | {lower:.0} | {all:.0} | {:.4} | {:.4} | {:.4} | {:.4} | {:.3} |",
            r.name,
            r.side,
            r.triangles,
            1e3 * r.outline_secs,
            1e3 * r.lower_secs,
            1e3 * r.compact_secs,
            1e3 * r.upper_secs,
            1e3 * r.march_secs,
        );
    }
    out.push('\n');
    out
}
