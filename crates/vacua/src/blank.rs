//! Why a picture shows nothing. Looks at scene and frame in the order in which light is lost: no
//! values, no opacity, nothing in view, everything cut away.

use glam::DVec3;
use vacua_render::{Frame, Integrator, RenderSettings, Scene};
use vacua_volume::{Bounds, TransferTable, ValueMap, ValueRange, ValueScale};

/// Alpha below which an 8-bit picture shows nothing.
const INVISIBLE: f32 = 0.5 / 255.0;
/// Rays a side with which the view is probed for the data's box.
const PROBES: usize = 64;

/// Says why a picture shows nothing and what to do about it; `None` if it shows something.
pub fn explain_blank(scene: &Scene, settings: &RenderSettings, frame: &Frame) -> Option<String> {
    if frame.rgba.iter().any(|pixel| pixel[3] >= INVISIBLE) {
        return None;
    }
    let reasons = [no_values, no_opacity, not_in_view, cut_away];
    let reason = reasons
        .iter()
        .find_map(|reason| reason(scene, settings))
        .unwrap_or_else(|| faint(scene, frame));
    Some(reason)
}

/// Nothing to show in the field itself.
fn no_values(scene: &Scene, _: &RenderSettings) -> Option<String> {
    let volume = &scene.data;
    if volume.num_cells() == 0 {
        return Some(
            "no cell with a volume is in the data, points and surfaces are not drawn".into(),
        );
    }
    if volume.profile().range.is_none() {
        return Some(format!(
            "no value of field `{}` is a finite number",
            volume.name()
        ));
    }
    let all_blanked = volume
        .blanked_cells()
        .is_some_and(|mask| mask.num_blank() == mask.len());
    all_blanked.then(|| "all cells are blanked (ghost or hidden cells)".to_owned())
}

/// All opacity zero in the data's range.
fn no_opacity(scene: &Scene, settings: &RenderSettings) -> Option<String> {
    let scalars = scene.data.scalars();
    let range = scene.data.profile().range?;
    let function = &scene.transfer_function;
    let ValueRange { lo, hi } = range;
    let values = if lo == hi {
        format!("the field is constant: {lo}")
    } else {
        format!("the data's values are {lo} to {hi}")
    };
    match settings.integrator {
        Integrator::March => {
            let map = match function.scale() {
                ValueScale::Linear => ValueMap::for_range(scalars.scalar_type(), range),
                ValueScale::Log => ValueMap::IDENTITY,
            };
            let points = function.opacities();
            TransferTable::new(function, range, map)
                .is_empty()
                .then(|| {
                    format!(
                        "opacity is 0 for every value there is: {values}, the opacity points are at {} to {}; give --range or --opacity in units of the data",
                        points[0].value,
                        points[points.len() - 1].value
                    )
                })
        }
        Integrator::MaximumIntensity => {
            let shown = function.color_range().lo;
            (hi <= shown).then(|| {
                format!(
                    "maximum intensity shows values above {shown}, the lower end of the colours, but {values}; give --range"
                )
            })
        }
    }
}

/// The data's box is not in the picture.
fn not_in_view(scene: &Scene, settings: &RenderSettings) -> Option<String> {
    let bounds = scene.data.bounds();
    let view = scene
        .camera
        .view(bounds, settings.width, settings.height)
        .ok()?;
    let at = |i: usize, side: usize| (i as f64 + 0.5) / PROBES as f64 * side as f64;
    let meets = (0..PROBES * PROBES).any(|i| {
        let (origin, direction) = view.ray(
            at(i % PROBES, settings.width),
            at(i / PROBES, settings.height),
        );
        meets_box(origin, direction, bounds)
    });
    (!meets).then(|| {
        format!(
            "the camera does not see the data, which lies in {}; try --camera orbit=30,20",
            box_text(bounds)
        )
    })
}

/// Whether a ray meets a box at or in front of its origin.
fn meets_box(origin: DVec3, direction: DVec3, bounds: Bounds) -> bool {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        let (o, d) = (origin[axis], direction[axis]);
        if d == 0.0 {
            if o < bounds.lo[axis] || o > bounds.hi[axis] {
                return false;
            }
            continue;
        }
        let t = [(bounds.lo[axis] - o) / d, (bounds.hi[axis] - o) / d];
        enter = enter.max(t[0].min(t[1]));
        leave = leave.min(t[0].max(t[1]));
    }
    enter <= leave
}

/// Clip planes or the region of interest leave nothing.
fn cut_away(scene: &Scene, _: &RenderSettings) -> Option<String> {
    let bounds = scene.data.bounds();
    if let Some(roi) = scene.region_of_interest {
        let apart = roi.lo.cmpgt(bounds.hi).any() || roi.hi.cmplt(bounds.lo).any();
        if apart {
            return Some(format!(
                "the region of interest lies outside the data, which is in {}",
                box_text(bounds)
            ));
        }
    }
    scene.clip_planes.iter().enumerate().find_map(|(i, plane)| {
        // The corner that lies furthest on the kept side.
        let corner = DVec3::select(plane.normal.cmpge(DVec3::ZERO), bounds.hi, bounds.lo);
        ((corner - plane.point).dot(plane.normal) < 0.0).then(|| {
            format!(
                "clip plane {i} cuts everything away; the side that its normal points to is kept"
            )
        })
    })
}

/// None of the plain reasons: the light that is left does not add up to anything visible.
fn faint(scene: &Scene, frame: &Frame) -> String {
    let samples = frame.total_samples();
    if samples == 0 {
        return "nothing that has any opacity lies in view".to_owned();
    }
    let peak = frame.rgba.iter().map(|pixel| pixel[3]).fold(0.0, f32::max);
    let values = scene.data.typical_scalars();
    let is_number = |i: usize| values.get_f64(i, 0).is_finite();
    if peak == 0.0 && !(0..values.tuples()).all(is_number) {
        return format!(
            "none of {samples} samples met a value: the field has some that are no finite numbers, and nothing is seen in cells with such a corner"
        );
    }
    format!(
        "{samples} samples add up to an alpha of at most {peak:e}; give higher --opacity, or a --unit below {}",
        scene.transfer_function.unit_length()
    )
}

fn box_text(Bounds { lo, hi }: Bounds) -> String {
    format!(
        "x {} to {}, y {} to {}, z {} to {}",
        lo.x, hi.x, lo.y, hi.y, lo.z, hi.z
    )
}
