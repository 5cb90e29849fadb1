//! What all tests on a device share: the device, scenes, and how pictures are compared.

// Each test program is compiled with all of this and uses a part.
#![allow(dead_code)]

use std::sync::Arc;

use glam::DVec3;
use vacua_gpu::{DeviceChoice, GpuOptions, GpuRenderer, Instance};
use vacua_render::{Camera, CpuRenderer, Frame, RenderSettings, Renderer, Scene, SkipMethod};
use vacua_volume::{
    Association, ColorPoint, ComponentChoice, DataArray, Dataset, Field, FieldChoice, Geometry,
    OpacityPoint, RectilinearGrid, Scalar, TransferFunction, UniformGrid, ValueScale, Volume,
};

/// Set where a device and the validation layer must be there: no test may be left out.
const REQUIRED: &str = "VACUA_GPU_REQUIRED";

/// A renderer on any device, with every call checked; `None` (said aloud) without a device.
pub fn renderer(options: GpuOptions) -> Option<GpuRenderer> {
    let is_required = std::env::var_os(REQUIRED).is_some();
    let instance = Instance::new(true).or_else(|e| {
        assert!(!is_required, "no validation layer: {e}");
        Instance::new(false)
    });
    let made = instance.and_then(|i| GpuRenderer::with_options(&i, DeviceChoice::Any, options));
    match made {
        Ok(renderer) => Some(renderer),
        Err(e) => {
            assert!(!is_required, "no device: {e}");
            eprintln!("SKIPPED: no Vulkan device to test on: {e}");
            None
        }
    }
}

/// Nothing was wrong in the eyes of the validation layer.
pub fn assert_valid(gpu: &GpuRenderer) {
    assert_eq!(gpu.device().complaints().unwrap_or(0), 0, "see the log");
}

/// A smooth field with empty space: shells and a blob, 0 to 1.
pub fn shells(p: DVec3) -> f64 {
    let r = (p - DVec3::splat(0.5)).length();
    let shell = (-((r - 0.33) / 0.035).powi(2)).exp();
    let blob = (-((p - DVec3::new(0.72, 0.6, 0.55)).length() / 0.1).powi(2)).exp();
    shell.max(0.9 * blob)
}

/// A field on the points of a grid; `to` turns 0 to 1 into a stored value.
pub fn volume<T: Scalar>(
    geometry: Geometry,
    association: Association,
    field: impl Fn(DVec3) -> f64,
    to: impl Fn(f64) -> T,
) -> Arc<Volume> {
    let sides = match association {
        Association::Point => geometry.points(),
        Association::Cell => geometry.points().map(|n| n - 1),
    };
    let [nx, ny, nz] = sides;
    let values: Vec<T> = (0..nx * ny * nz)
        .map(|i| {
            let at = [i % nx, i / nx % ny, i / nx / ny];
            let unit = [0, 1, 2].map(|a| at[a] as f64 / (sides[a] - 1) as f64);
            to(field(DVec3::from(unit)))
        })
        .collect();
    let array = DataArray::from_vec(values, 1).expect("one component");
    let dataset = Dataset::new(geometry, vec![Field::new("f", association, array)]);
    let volume = dataset.and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto));
    Arc::new(volume.expect("it fits together"))
}

pub fn uniform(points: [usize; 3]) -> Geometry {
    let spacing = DVec3::new(1.0, 0.8, 1.3);
    Geometry::Uniform(UniformGrid::new(points, DVec3::splat(-3.0), spacing).expect("a grid"))
}

/// Planes that draw apart from one side to the other.
pub fn stretched(points: [usize; 3]) -> Geometry {
    let planes = |n: usize, growth: f64| {
        let mut at = vec![0.0];
        for i in 1..n {
            at.push(at[i - 1] + growth.powi(i as i32));
        }
        at
    };
    let [x, y, z] = points;
    let grid = RectilinearGrid::new(planes(x, 1.05), planes(y, 1.0), planes(z, 1.12));
    Geometry::Rectilinear(grid.expect("increasing planes"))
}

/// A look from `lo` to `hi`, clear below a quarter of the way.
pub fn look(lo: f64, hi: f64, unit: f64, scale: ValueScale) -> TransferFunction {
    let at = |f: f64| scale.at(vacua_volume::ValueRange { lo, hi }, f);
    let color = |f, srgb| ColorPoint { value: at(f), srgb };
    let opacity = |f, opacity| OpacityPoint {
        value: at(f),
        opacity,
    };
    let function = TransferFunction::new(
        vec![
            color(0.0, [0.1, 0.2, 0.9]),
            color(0.6, [0.9, 0.9, 0.8]),
            color(1.0, [0.9, 0.2, 0.1]),
        ],
        vec![opacity(0.0, 0.0), opacity(0.25, 0.0), opacity(1.0, 0.4)],
        unit,
        scale,
    );
    function.expect("points in order")
}

pub fn scene(volume: Arc<Volume>, look: TransferFunction) -> Scene {
    Scene::new(volume, look).camera(Camera::orbit(35.0, 25.0))
}

pub fn settings() -> RenderSettings {
    RenderSettings {
        width: 96,
        height: 72,
        skip: SkipMethod::Grid,
        ..RenderSettings::default()
    }
}

pub fn on_cpu(scene: &Scene, settings: &RenderSettings) -> Frame {
    let mut cpu = CpuRenderer::new(Some(1)).expect("a thread");
    cpu.render(scene, settings).expect("a good scene").frame
}

/// A picture over black in 8 bits, as a PNG has it.
pub fn eight_bit(frame: &Frame) -> Vec<[u8; 3]> {
    let encode = |linear: f32| {
        let srgb = vacua_volume::srgb_from_linear(f64::from(linear.clamp(0.0, 1.0)));
        (255.0 * srgb).round() as u8
    };
    let pixels = frame.rgba.iter();
    pixels.map(|p| [0, 1, 2].map(|c| encode(p[c]))).collect()
}

/// Peak signal-to-noise ratio in dB, and the largest difference in 8-bit steps.
pub fn compare(a: &Frame, b: &Frame) -> (f64, u8) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let (a, b) = (eight_bit(a), eight_bit(b));
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    let (mut sum, mut largest) = (0.0, 0);
    for (a, b) in pairs {
        let apart = a.abs_diff(*b);
        sum += f64::from(apart).powi(2);
        largest = largest.max(apart);
    }
    let mean = sum / (3 * a.len()) as f64;
    (10.0 * (255.0f64.powi(2) / mean.max(1e-12)).log10(), largest)
}

/// The contract between devices.
pub fn assert_alike(what: &str, gpu: &Frame, cpu: &Frame) {
    let (psnr, largest) = compare(gpu, cpu);
    eprintln!("{what}: {psnr:.1} dB, largest difference {largest}");
    assert!(!cpu.is_blank(), "{what}: something is seen");
    assert!(psnr >= 50.0, "{what}: {psnr:.1} dB");
    assert!(largest <= 8, "{what}: {largest} steps apart");
}

/// Same bits in every plane but the cost.
pub fn assert_same_bits(what: &str, a: &Frame, b: &Frame) {
    let bits = |f: &Frame| -> Vec<u32> {
        let rgba = f.rgba.iter().flatten();
        rgba.chain(&f.depth).map(|v| v.to_bits()).collect()
    };
    let (x, y) = (bits(a), bits(b));
    let wrong = x.iter().zip(&y).filter(|(x, y)| x != y).count();
    assert_eq!(wrong, 0, "{what}: numbers that differ");
}
