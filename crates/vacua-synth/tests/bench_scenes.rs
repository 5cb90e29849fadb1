//! The benchmark scenes are the published arrays, byte for byte.

use sha2::{Digest, Sha256};
use vacua_synth::{Kind, Spec, generate, meshes};

fn hash16(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest[..8].iter().map(|b| format!("{b:02x}")).collect()
}

#[test]
fn shells256_is_the_published_array() {
    let made = generate(&Spec::new(Kind::Shells)).expect("64 MiB");
    let values = made.fields()[0].load().expect("in memory");
    let above = values.as_slice::<f32>().expect("f32");
    let share = above.iter().filter(|&&v| v > 0.25).count() as f64 / above.len() as f64;
    assert!((share - 0.0992).abs() < 5e-5, "{share}");
    assert_eq!(hash16(values.bytes()), "080baf494f317abb");
}

#[test]
fn tet100_is_the_published_mesh() {
    let mesh = meshes::tetrahedra(100, 1).expect("6 million");
    assert_eq!(mesh.cells.len(), 6_000_000);
    assert_eq!(
        hash16(bytemuck::cast_slice(&mesh.cells)),
        "fa482559aad042c4"
    );
    assert_eq!(
        hash16(bytemuck::cast_slice(&mesh.vertices)),
        "4b50b049d81c70bb"
    );
    assert_eq!(
        hash16(bytemuck::cast_slice(&mesh.scalars)),
        "ec3f78a97eba57bf"
    );
}

#[test]
fn hex150_is_the_published_mesh() {
    let mesh = meshes::hexahedra(150, 2).expect("3.4 million");
    assert_eq!(mesh.vertices.len(), 3_442_951);
    assert_eq!(
        hash16(bytemuck::cast_slice(&mesh.cells)),
        "2a0a16095240d5c3"
    );
    assert_eq!(
        hash16(bytemuck::cast_slice(&mesh.vertices)),
        "19edd78122ac2d6b"
    );
    assert_eq!(
        hash16(bytemuck::cast_slice(&mesh.scalars)),
        "f3a783935182f35a"
    );
}
