//! The benches of a GPU run, tiny, on whatever device there is, and every picture is exact.

use vacua_bench::gpu::{self, GpuMethod, GpuOptions};
use vacua_bench::gpu_mesh::MeshChoice;
use vacua_bench::gpu_reference::{self, DevicePeer, GpuReferenceOptions, GpuReferenceResults};
use vacua_bench::sample::Share;
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

#[test]
fn meshes_in_the_encodings_of_paper_b() {
    if !has_device() {
        return;
    }
    let choice = |text: &str| text.parse::<MeshChoice>().expect("a mesh");
    let results = gpu_reference::run(&GpuReferenceOptions {
        device: DeviceChoice::Any,
        meshes: vec![choice("tet100:6"), choice("hex150:6")],
        shuffled: true,
        size: (24, 16),
        repeats: 1,
        places: 500,
        shares: [(4, 64), (3, 8), (8, 8)]
            .map(|(part, of)| Share { part, of })
            .into(),
    });
    let results = results.expect("a device");
    let [tets, hexes] = &results.meshes[..] else {
        panic!("two meshes, not {}", results.meshes.len());
    };
    assert_eq!(tets.peers.len(), 5);
    for peer in &tets.peers {
        assert!(peer.bytes.value().is_some_and(|n| n > 0), "{}", peer.name);
        assert!(peer.random_per_sec.value().is_some(), "{}", peer.name);
        // Variant 1 may number cells in another order.
        let most = if peer.name.ends_with("variant 1") {
            1e-6
        } else {
            0.0
        };
        assert!(
            peer.difference.value().is_some_and(|d| d <= most),
            "{}",
            peer.name
        );
    }
    let there = |peer: &&DevicePeer| peer.march_secs.value().is_some();
    assert_eq!(
        hexes.peers.iter().filter(there).count(),
        3,
        "as hexahedra are"
    );
    assert_eq!(results.shares.len(), 3);
    for share in &results.shares {
        assert_eq!(share.peers.len(), 4);
        let bytes = share
            .peers
            .iter()
            .map(|p| p.bytes.value().unwrap_or_else(|| panic!("{p:?}")));
        let bytes: Vec<u64> = bytes.collect();
        assert!(bytes[0] < bytes[1] && bytes[3] < bytes[2], "{bytes:?}");
    }
    let text = results.markdown();
    for part in [
        "Table 3",
        "Table 4",
        "Table 6",
        "tetrahedra only",
        "shared faces",
    ] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    let json = serde_json::to_string(&results).expect("plain data");
    let read: GpuReferenceResults = serde_json::from_str(&json).expect("what was written");
    assert_eq!(read, results);
}
