//! The benches of a GPU run, tiny, on whatever device there is, and every picture is exact.

use vacua_bench::gpu::{self, GpuMethod, GpuOptions};
use vacua_bench::skip::{self, Model, SkipOptions};
use vacua_gpu::{DeviceChoice, Instance};
use vacua_synth::Kind;

/// Whether there is a device that traces rays; says so if not.
fn has_device() -> bool {
    let opened = Instance::new(false).and_then(|i| i.open(DeviceChoice::Any));
    match opened {
        Ok(device) if device.info().has_ray_tracing() => true,
        other => {
            let required = std::env::var_os("VACUA_GPU_REQUIRED").is_some();
            assert!(!required, "no device that traces rays: {other:?}");
            eprintln!("SKIPPED: no Vulkan device that traces rays");
            false
        }
    }
}

#[test]
fn every_method_of_the_gpu_bench() {
    if !has_device() {
        return;
    }
    let methods = ["grid", "mesh", "query", "boxes", "auto"].map(|name| name.parse());
    let methods: Result<Vec<GpuMethod>, String> = methods.into_iter().collect();
    let results = gpu::run(&GpuOptions {
        device: DeviceChoice::All,
        kinds: vec![Kind::Blobs],
        points: Some([24, 24, 24]),
        size: (32, 24),
        repeats: 1,
        sides: vec![4],
        reaches: vec![16],
        methods: methods.expect("names"),
        structures: true,
        shaded: false,
        pictures: None,
    });
    let results = results.expect("a device");
    assert!(!results.scenes.is_empty());
    for scene in &results.scenes {
        assert_eq!(scene.rows.len(), 6, "none and five methods: {}", scene.name);
        assert!(scene.rows.iter().all(|row| row.is_exact), "{}", scene.name);
        assert_eq!(scene.structures.len(), 5, "{}", scene.name);
    }
    assert!(results.groups.iter().all(|row| row.is_exact));
    let text = results.markdown();
    for part in [
        "mesh by queries",
        "boxes",
        "fast trace, compacted",
        "Several devices",
    ] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    assert!("pyramid".parse::<GpuMethod>().is_err());
}

#[test]
fn tables_of_the_paper_on_a_gpu() {
    if !has_device() {
        return;
    }
    let results = skip::run(&SkipOptions {
        scale: 0.06,
        size: (24, 16),
        repeats: 1,
        sides: vec![8],
        models: vec![Model::Heptane],
        quick: true,
        device: Some(DeviceChoice::Any),
        ..SkipOptions::default()
    });
    let results = results.expect("a device");
    assert!(results.device.is_some());
    let build = &results.models[0].builds[0];
    assert!(build.triangles.value().is_some_and(|n| n > 0));
    assert!(build.boxes_count.value().is_some_and(|n| n > 0));
    for stages in [&build.mesh, &build.boxes] {
        assert!(stages.hierarchy_secs.value().is_some_and(|secs| secs > 0.0));
        assert!(stages.total_secs.value().is_some_and(|secs| secs > 0.0));
    }
    assert!(results.markdown().contains("Rendered on"));
}
