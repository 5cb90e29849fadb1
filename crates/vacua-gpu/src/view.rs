//! From scene and settings to the parameters that shaders make rays of. In `f64`, once a picture.

use glam::{DMat3, DVec3};
use vacua_render::contract::RaySpace;
use vacua_render::{RenderError, RenderSettings, Scene};
use vacua_skip::MAX_SAMPLES;

use crate::shared::Parameters;

/// Fills in what depends on camera, step and space.
///
/// # Errors
/// [`RenderError::Camera`], or [`RenderError::StepTooSmall`].
pub(crate) fn rays(
    parameters: &mut Parameters,
    scene: &Scene,
    settings: &RenderSettings,
    space: &RaySpace,
) -> Result<(), RenderError> {
    let bounds = scene.data.bounds();
    let view = scene
        .camera
        .view(bounds, settings.width, settings.height)?
        .basis();
    let plane = |last: bool| {
        let axes = space.axes.each_ref();
        DVec3::from(axes.map(|a| f64::from(a.plane(if last { a.cells() } else { 0 }))))
    };
    let (box_lo, box_hi) = (plane(false), plane(true));
    let samples = ((box_hi - box_lo) / space.finest).length() / settings.step;
    let limit = MAX_SAMPLES / 2;
    if samples > f64::from(limit) {
        return Err(RenderError::StepTooSmall {
            step: settings.step,
            samples,
            limit,
        });
    }
    // Rays are anchored in the plane through the middle of the data, or at a camera beyond it.
    let away = (bounds.center() - view.eye).dot(view.forward).max(0.0);
    let spread = if view.parallel { 1.0 } else { away };
    let linear: DMat3 = space.ray_from_world.matrix3;
    let anchor = space
        .ray_from_world
        .transform_point3(view.eye + away * view.forward);
    let (right, up) = (linear * view.right, linear * view.up);
    let forward = linear * view.forward;
    let (turn_x, turn_y) = if view.parallel {
        (DVec3::ZERO, DVec3::ZERO)
    } else {
        (right, up)
    };
    let wide = |v: DVec3| [v.x, v.y, v.z, 0.0];
    let narrow = |v: DVec3, w: f64| v.extend(w).as_vec4().to_array();
    let finest = space.finest;
    parameters.rate = wide(forward / finest);
    parameters.rate_x = wide(turn_x / finest);
    parameters.rate_y = wide(turn_y / finest);
    parameters.grid = [
        away / settings.step,
        2.0 / settings.width as f64,
        2.0 / settings.height as f64,
        0.0,
    ];
    parameters.anchor = narrow(anchor, finest.x);
    parameters.anchor_x = narrow(spread * right, finest.y);
    parameters.anchor_y = narrow(spread * up, finest.z);
    parameters.direction = narrow(forward, 0.0);
    parameters.direction_x = narrow(turn_x, 0.0);
    parameters.direction_y = narrow(turn_y, 0.0);
    let [across_x, across_y] = if view.parallel {
        [0.0; 2]
    } else {
        [view.right, view.up].map(|v| v.length_squared())
    };
    // What rounding can move a computed coordinate by: rays start at most a window of samples and
    // some from the box.
    let extent = box_lo.abs().max(box_hi.abs()).max_element();
    let farthest = 2.0 * extent + 600.0 * settings.step * finest.max_element();
    let squares = [1.0, across_x, across_y, 2.5e-7 * farthest];
    parameters.length_sq = squares.map(|v| v as f32);
    parameters.box_lo = narrow(box_lo, settings.step);
    parameters.box_hi = narrow(box_hi, f64::from(settings.termination));
    let rows = linear.transpose();
    let (x, y, z) = (rows.x_axis, rows.y_axis, rows.z_axis);
    let squares = DVec3::new(x.dot(x), y.dot(y), z.dot(z));
    let products = 2.0 * DVec3::new(x.dot(y), x.dot(z), y.dot(z));
    parameters.metric_squares = narrow(squares, 0.0);
    parameters.metric_products = narrow(products, 0.0);
    parameters.picture[0] = settings.width as u32;
    parameters.picture[1] = settings.height as u32;
    Ok(())
}

/// The half spaces of ray space that are seen, as (normal, offset): `normal · p + offset >= 0`.
pub(crate) fn half_spaces(scene: &Scene, space: &RaySpace) -> Vec<[f32; 4]> {
    let world_from_ray = space.ray_from_world.inverse();
    let half_space = |point: DVec3, normal: DVec3| {
        let in_ray_space = world_from_ray.matrix3.transpose() * normal;
        let offset = (world_from_ray.translation - point).dot(normal);
        let plane = in_ray_space.extend(offset) / in_ray_space.length();
        plane.as_vec4().to_array()
    };
    let mut planes: Vec<[f32; 4]> = scene
        .clip_planes
        .iter()
        .map(|plane| half_space(plane.point, plane.normal))
        .collect();
    if let Some(region) = scene.region_of_interest {
        for axis in DMat3::IDENTITY.to_cols_array_2d().map(DVec3::from) {
            planes.push(half_space(region.lo, axis));
            planes.push(half_space(region.hi, -axis));
        }
    }
    planes
}
