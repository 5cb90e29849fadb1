//! The heat map: how many samples each pixel took.

use std::path::Path;

use vacua_io::picture::{Picture, write_picture};
use vacua_render::Frame;
use vacua_volume::{ValueRange, linear_from_srgb, presets};

use crate::command::Failure;

/// The colour map of heat.
const COLORS: &str = "inferno";

/// Writes the samples a pixel as colours from black to yellow, and in an EXR also as plane `cost`;
/// with `without`, the left half shows that frame. Returns the largest number.
pub fn write(path: &Path, frame: &Frame, without: Option<&Frame>) -> Result<u32, Failure> {
    let width = frame.width;
    let samples: Vec<u32> = (0..frame.samples.len())
        .map(|i| match without {
            Some(other) if i % width < width / 2 => other.samples[i],
            _ => frame.samples[i],
        })
        .collect();
    let most = samples.iter().copied().max().unwrap_or(0);
    let unit = ValueRange { lo: 0.0, hi: 1.0 };
    let colors: Vec<[f32; 4]> = presets::color_points(COLORS, unit)
        .map_err(|e| Failure::Other(Box::new(e)))?
        .iter()
        .map(|point| {
            let [r, g, b] = point.srgb.map(|c| linear_from_srgb(c) as f32);
            [r, g, b, 1.0]
        })
        .collect();
    let last = colors.len() - 1;
    let rgba: Vec<[f32; 4]> = samples
        .iter()
        .map(|&n| colors[n as usize * last / most.max(1) as usize])
        .collect();
    let cost: Vec<f32> = samples.iter().map(|&n| n as f32).collect();
    let picture = Picture {
        width,
        height: frame.height,
        rgba: &rgba,
        depth: None,
        cost: Some(&cost),
    };
    write_picture(path, &picture, Some([0.0; 3]))?;
    Ok(most)
}
