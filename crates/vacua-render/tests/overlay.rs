//! The boundary drawn over a picture is where the active macrocells are.

use glam::DVec3;
use vacua_render::{
    Camera, CpuRenderer, Overlay, Projection, RenderSettings, Renderer, Scene, SkipMethod,
};
use vacua_volume::{
    Association, ColorPoint, ComponentChoice, DataArray, Dataset, Field, FieldChoice, Geometry,
    OpacityPoint, TransferFunction, UniformGrid, ValueScale,
};

/// One bright cell in the middle macrocell of three a side, seen along z.
#[test]
fn lines_lie_on_the_edges_of_the_active_macrocell() {
    let points = [13; 3];
    let mut values = vec![0u8; 13 * 13 * 13];
    values[6 + 13 * (6 + 13 * 6)] = 255;
    let array = DataArray::from_vec(values, 1).expect("one component");
    let grid = UniformGrid::new(points, DVec3::ZERO, DVec3::ONE).expect("a good grid");
    let field = Field::new("f", Association::Point, array);
    let volume = Dataset::new(Geometry::Uniform(grid), vec![field])
        .and_then(|d| d.volume(&FieldChoice::Only, ComponentChoice::Auto))
        .expect("it fits together");
    let white = vec![ColorPoint {
        value: 0.0,
        srgb: [1.0; 3],
    }];
    let opacities = [(0.0, 0.0), (200.0, 0.0), (255.0, 0.1)];
    let opacities = opacities.map(|(value, opacity)| OpacityPoint { value, opacity });
    let look = TransferFunction::new(white, opacities.to_vec(), 1.0, ValueScale::Linear);
    // Ten pixels a cell; cell 0 begins at pixel 0.
    let camera = Camera::Placed {
        eye: DVec3::new(6.0, 6.0, 40.0),
        at: DVec3::splat(6.0),
        up: DVec3::Y,
        projection: Projection::Orthographic { height: 12.0 },
    };
    let scene = Scene::new(volume, look.expect("in order")).camera(camera);
    for skip in [SkipMethod::None, SkipMethod::Grid, SkipMethod::Mesh] {
        let plain = RenderSettings {
            width: 120,
            height: 120,
            skip,
            macrocell_side: Some(4),
            ..Default::default()
        };
        let lined = RenderSettings {
            overlay: Overlay::Boundary,
            ..plain.clone()
        };
        let mut renderer = CpuRenderer::new(Some(1)).expect("a thread");
        let without = renderer.render(&scene, &plain).expect("a good scene").frame;
        let with = renderer.render(&scene, &lined).expect("a good scene").frame;
        assert_eq!(without.depth, with.depth);
        assert_eq!(without.samples, with.samples);
        for (i, (a, b)) in without.rgba.iter().zip(&with.rgba).enumerate() {
            // Pixel centres from the edges of the middle macrocell, 40 to 80.
            let from_edge = [i % 120, i / 120].map(|p| {
                let at = p as f64 + 0.5;
                (at - 40.0).abs().min((at - 80.0).abs())
            });
            let inside = [i % 120, i / 120].iter().all(|p| (40..80).contains(p));
            let on_line = inside && from_edge[0].min(from_edge[1]) < 1.0;
            assert_eq!(a != b, on_line, "{skip:?}, pixel {}, {}", i % 120, i / 120);
        }
    }
}
