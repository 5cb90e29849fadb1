//! Values at points of meshes: as VTK's probe filter finds them in real files, and exact for linear
//! fields in cells of all four types (`vacua-pack`'s tests).

use std::path::{Path, PathBuf};

use glam::DVec3;
use vacua_render::VolumeSampler;
use vacua_volume::{ComponentChoice, FieldChoice};

fn data_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../vacua-io/tests/data")
}

#[test]
fn are_those_that_vtk_finds() {
    for (file, field, component, table) in [
        ("warped.vtu", "wave", None, "warped_wave"),
        ("can.vtu", "DISPL", Some(2), "can_displ"),
        ("can.vtu", "EQPS", None, "can_eqps"),
        ("post.vtk", "Pressure", None, "post_pressure"),
        ("hexa.vtk", "scalars", None, "hexa_scalars"),
        (
            "notch_stress.vtk",
            "Nodal Stress",
            Some(0),
            "notch_stress_nodal",
        ),
        ("disk_out_ref.ex2", "Temp", None, "disk_out_ref_temp"),
    ] {
        let dataset = vacua_io::open(data_folder().join(file)).expect("readable");
        let component = component.map_or(ComponentChoice::Auto, ComponentChoice::Index);
        let volume = dataset
            .volume(&FieldChoice::Name(field.into()), component)
            .expect("a field");
        let sampler = VolumeSampler::new(&volume).expect("a mesh");
        let width = volume.scalars().range(0).expect("finite values").width();
        let table = data_folder().join("probe").join(format!("{table}.csv"));
        let text = std::fs::read_to_string(table).expect("committed");
        let (mut worst, mut num_inside) = (0.0f64, 0);
        for line in text.lines().skip(1) {
            let cells: Vec<&str> = line.split(',').collect();
            let number = |i: usize| cells[i].parse::<f64>().expect("a number");
            let at = DVec3::new(number(0), number(1), number(2));
            let found = sampler.sample(at);
            assert_eq!(found.is_some(), cells[3] == "1", "{file} at {at}");
            if let Some(found) = found {
                worst = worst.max((found - number(4)).abs() / width);
                num_inside += 1;
            }
        }
        assert!(
            worst <= 1e-9,
            "{file}, {field}: off by {worst} of the range"
        );
        assert!(num_inside >= 140, "{file}: only {num_inside} points inside");
    }
}
