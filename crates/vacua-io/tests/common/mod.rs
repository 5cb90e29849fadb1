//! What tests against files of other programs share.

use vacua_io::Dataset;
use vacua_volume::{DataArray, Geometry, UniformGrid};

/// Its grid, which is to be uniform.
pub fn grid(dataset: &Dataset) -> &UniformGrid {
    match &**dataset.geometry() {
        Geometry::Uniform(grid) => grid,
        other => panic!("a uniform grid, not {}", other.kind()),
    }
}

/// The two sums that each `expected.tsv` holds, as the `make.py` beside it computes them.
pub fn sums(values: &DataArray) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for i in 0..values.tuples() * values.components() {
        let v = values.get_f64(i / values.components(), i % values.components());
        sums[0] += v;
        sums[1] += v * (i % 97 + 1) as f64;
    }
    sums
}
