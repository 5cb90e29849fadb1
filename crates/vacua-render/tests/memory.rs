//! What skipping takes beside the voxels: at most a twentieth of them at eight cells a macrocell.

use glam::DVec3;
use vacua_render::{CpuRenderer, RenderSettings, Renderer, Scene, SkipMethod};
use vacua_volume::{
    Association, ColorPoint, ComponentChoice, DataArray, Dataset, Field, FieldChoice, Geometry,
    OpacityPoint, RectilinearGrid, TransferFunction, UniformGrid, ValueScale,
};

#[test]
fn skipping_takes_at_most_a_twentieth_of_the_voxels() {
    let points = [129; 3];
    let planes = |_| {
        (0..129)
            .map(|i| f64::from(i).powf(1.2))
            .collect::<Vec<f64>>()
    };
    let [x, y, z] = [0, 1, 2].map(planes);
    let geometries = [
        Geometry::Uniform(UniformGrid::new(points, DVec3::ZERO, DVec3::ONE).expect("a grid")),
        Geometry::Rectilinear(RectilinearGrid::new(x, y, z).expect("increasing")),
    ];
    // One byte a voxel is where the share is largest.
    let values: Vec<u8> = (0..129usize.pow(3)).map(|i| ((i * i) >> 7) as u8).collect();
    for geometry in geometries {
        let array = DataArray::from_vec(values.clone(), 1).expect("one component");
        let field = Field::new("f", Association::Point, array);
        let volume = Dataset::new(geometry, vec![field])
            .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
            .expect("it fits together");
        let colors = vec![ColorPoint {
            value: 0.0,
            srgb: [1.0; 3],
        }];
        let opacities = [(0.0, 0.0), (255.0, 0.5)];
        let opacities = opacities.map(|(value, opacity)| OpacityPoint { value, opacity });
        let look = TransferFunction::new(colors, opacities.to_vec(), 1.0, ValueScale::Linear);
        let scene = Scene::new(volume, look.expect("in order"));
        let choices = [(SkipMethod::Grid, Some(8)), (SkipMethod::Auto, Some(8))];
        for (skip, macrocell_side) in choices {
            let settings = RenderSettings {
                width: 384,
                height: 384,
                skip,
                macrocell_side,
                ..Default::default()
            };
            let mut renderer = CpuRenderer::new(Some(2)).expect("threads");
            let report = renderer
                .render(&scene, &settings)
                .expect("a good scene")
                .report;
            let share = (report.macrocell_bytes + report.skip_bytes) as f64 / values.len() as f64;
            assert!(
                share > 0.0 && share <= 0.05,
                "{skip:?}: {share:.3} of the voxels"
            );
        }
    }
}
