//! Gradients of a field where its cells are known.
use vacua_simd::LANES;
use vacua_volume::Association;

use super::{BlockSampler, Located, Places};
use crate::element::gradient_at;

impl BlockSampler<'_> {
    /// Gradients of the values at the places that were found, axis by axis; 0 for fields on cells.
    pub fn gradients(&self, at: &Places, located: &Located) -> [[f32; LANES]; 3] {
        let mut gradients = [[0.0; LANES]; 3];
        if self.field.association() == Association::Cell {
            return gradients;
        }
        let mut locator = self.mesh.locator();
        for lane in (0..LANES).filter(|lane| located.found >> lane & 1 == 1) {
            let Some(location) = locator.locate_local(at.map(|c| f64::from(c[lane]))) else {
                continue;
            };
            let Some(submesh) = self.mesh.submesh(location.cell.submesh as usize) else {
                continue;
            };
            let Some(corners) = submesh.corner_positions(&location.cell) else {
                continue;
            };
            let values = self.corner_values(&location);
            let gradient = gradient_at(location.cell.cell_type, &corners, &values, &location.weights);
            for axis in 0..3 {
                gradients[axis][lane] = gradient[axis] as f32;
            }
        }
        gradients
    }
}
