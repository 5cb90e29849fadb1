//! The stand-ins have the shares of active macrocells that the originals have in Table 1 of paper A.

use vacua_synth::{Kind, Spec, generate};
use vacua_volume::{ScalarType, TransferTable, ValueMap, ValueRange};

/// Share of macrocells of `k³` cells whose value range the named transfer function makes visible.
fn active_share(values: &[u8], points: [usize; 3], table: &TransferTable, k: usize) -> f64 {
    let [nx, ny, nz] = points;
    let cells = points.map(|n| (n - 1).div_ceil(k));
    let mut active = 0;
    for cz in 0..cells[2] {
        for cy in 0..cells[1] {
            let mut ranges = vec![(u8::MAX, u8::MIN); cells[0]];
            for z in cz * k..=((cz + 1) * k).min(nz - 1) {
                for y in cy * k..=((cy + 1) * k).min(ny - 1) {
                    let row = &values[(z * ny + y) * nx..][..nx];
                    for (cx, range) in ranges.iter_mut().enumerate() {
                        for &v in &row[cx * k..=((cx + 1) * k).min(nx - 1)] {
                            *range = (range.0.min(v), range.1.max(v));
                        }
                    }
                }
            }
            let is_active = |r: &&(u8, u8)| table.is_active(r.0.into(), r.1.into());
            active += ranges.iter().filter(is_active).count();
        }
    }
    active as f64 / cells.iter().product::<usize>() as f64
}

/// Checks shares at several K within a relative tolerance.
fn check(kind: Kind, look: &str, points: [usize; 3], tolerance: f64, expected: &[(usize, f64)]) {
    let made = generate(&Spec::new(kind).with_points(points)).expect("fits in memory");
    let values = made.fields()[0].load().expect("in memory");
    let values = values.as_slice::<u8>().expect("u8 by default");
    let looks = kind.transfer_functions(ScalarType::U8).expect("valid");
    let (_, function) = looks
        .into_iter()
        .find(|(name, _)| *name == look)
        .expect("the kind has this look");
    let range = ValueRange { lo: 0.0, hi: 255.0 };
    let table = TransferTable::new(&function, range, ValueMap::IDENTITY);
    for &(k, share) in expected {
        let actual = active_share(values, points, &table, k);
        assert!(
            (actual / share - 1.0).abs() <= tolerance,
            "{kind} {look} K = {k}: {actual:.4}, expected {share:.4}"
        );
    }
}

#[test]
fn heptane_is_like_the_original() {
    let paper = [(8, 12.3 / 54.9), (16, 2.0 / 6.9), (32, 0.358)];
    check(Kind::Heptane, "default", [302; 3], 0.05, &paper);
}

#[test]
fn flower_is_like_the_original() {
    // A quarter of the size with a quarter of K; at full size the shares differ by a few percent.
    let paper = [(2, 180.0 / 2100.0), (4, 33.0 / 275.0), (8, 6.8 / 33.0)];
    check(Kind::Flower, "default", [256; 3], 0.15, &paper);
}

#[test]
fn dns_is_like_the_original() {
    let paper = [(8, 660.0 / 3700.0), (16, 122.0 / 461.0), (32, 26.0 / 58.0)];
    check(Kind::Dns, "default", [1024, 768, 384], 0.15, &paper);
}

#[test]
fn llnl_is_like_the_original() {
    let paper = [(8, 2.9 / 15.7), (16, 475.0 / 1970.0)];
    check(Kind::Llnl, "default", [512, 512, 480], 0.15, &paper);
}

#[test]
fn blobs_are_as_the_benchmark_describes_them() {
    check(Kind::Blobs, "default", [256; 3], 0.13, &[(4, 0.08)]);
    check(Kind::Blobs, "haze", [256; 3], 0.1, &[(4, 0.30)]);
}
