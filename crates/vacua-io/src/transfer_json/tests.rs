use proptest::prelude::*;
use vacua_volume::{
    ColorPoint, ColorSpace, OpacityPoint, TransferFunction, TransferFunctionError, ValueScale,
};

use super::*;
use crate::Problem;

fn read(text: &str) -> Result<TransferFile, Problem> {
    transfer_function_from_json(text.as_bytes(), 2.5)
}

fn message(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

/// ParaView's own export of "Cool to Warm", with an opacity curve.
const PARAVIEW: &str = r#"[
	{
		"ColorSpace" : "Diverging",
		"Creator" : "someone",
		"DefaultMap" : true,
		"Name" : "Cool to Warm",
		"NanColor" : [ 1, 1, 0 ],
		"Points" : [ 0.0, 0.0, 0.5, 0.0, 100.0, 1.0, 0.25, 0.0, 200.0, 0.5, 0.5, 0.0 ],
		"RGBPoints" :
		[
			0.0, 0.23137254902000001, 0.298039215686, 0.75294117647100001,
			200.0, 0.70588235294099999, 0.015686274509800001, 0.149019607843
		]
	}
]"#;

#[test]
fn paraviews_cool_to_warm() {
    let file = read(PARAVIEW).expect("ParaView's file");
    let f = &file.function;
    assert_eq!(f.unit_length(), 2.5);
    // ParaView draws the middle of this map as (0.865, 0.865, 0.865).
    for c in f.srgb_at(100.0) {
        assert!((c - 0.865).abs() < 2e-3, "{:?}", f.srgb_at(100.0));
    }
    let (cool, warm) = (
        [0.23137254902, 0.298039215686, 0.752941176471],
        [0.705882352941, 0.0156862745098, 0.149019607843],
    );
    for i in 0..=1000 {
        let t = f64::from(i) / 1000.0;
        let exact = ColorSpace::Diverging.mix(cool, warm, t);
        let got = f.srgb_at(200.0 * t);
        for c in 0..3 {
            // The ends are the file's numbers, the curve there differs by the rounding of matrices.
            assert!(
                (got[c] - exact[c]).abs() < 2.0 * CURVE_TOLERANCE,
                "{t}: {got:?} {exact:?}"
            );
        }
    }
    assert_eq!(f.opacity_at(50.0), 0.5);
    // Midpoint 0.25 between 100 and 200: half way in opacity at 125.
    assert!((f.opacity_at(125.0) - 0.75).abs() < 1e-12);
    assert!((f.opacity_at(175.0) - (0.75 - 0.25 * 2.0 / 3.0)).abs() < 1e-12);
    assert!(
        file.notes.iter().any(|n| n.contains("NanColor")),
        "{:?}",
        file.notes
    );
}

#[test]
fn sharp_opacities_follow_the_toolkit() {
    // Values of vtkPiecewiseFunction::GetTable for (0, 0) to (1, 1), midpoint 0.5, sharpness 0.5:
    // the place s becomes 0.5 (2s)^6 below the middle, then the Hermite curve with slope 0.5.
    let text = r#"{"RGBPoints": [0,0,0,0, 1,1,1,1], "Points": [0,0,0.5,0.5, 1,1,0.5,0]}"#;
    let f = read(text).expect("a map").function;
    for (x, s) in [
        (0.25f64, 0.5f64 * 0.5f64.powi(6)),
        (0.4, 0.5 * 0.8f64.powi(6)),
        (0.5, 0.5),
    ] {
        let hermite = 3.0 * s * s - 2.0 * s.powi(3) + 0.5 * (2.0 * s.powi(3) - 3.0 * s * s + s);
        assert!((f.opacity_at(x) - hermite).abs() < CURVE_TOLERANCE, "{x}");
        assert!(
            (f.opacity_at(1.0 - x) - (1.0 - hermite)).abs() < CURVE_TOLERANCE,
            "{x}"
        );
    }
    let text = r#"{"RGBPoints": [0,0,0,0, 1,1,1,1], "Points": [0,0,0.3,1, 1,1,0.5,0]}"#;
    let f = read(text).expect("a map").function;
    assert_eq!((f.opacity_at(0.299), f.opacity_at(0.301)), (0.0, 1.0));
}

#[test]
fn steps_and_logarithms() {
    let text = r#"{"ColorSpace": "Step", "RGBPoints": [0,1,0,0, 1,0,1,0, 2,0,0,1]}"#;
    let f = read(text).expect("a map").function;
    assert_eq!(f.srgb_at(0.5), [0.0, 1.0, 0.0]);
    assert_eq!(f.srgb_at(1.5), [0.0, 0.0, 1.0]);
    let text = r#"{"ColorSpace": "RGB", "UseLogScale": 1, "RGBPoints": [1,0,0,0, 100,1,1,1]}"#;
    let f = read(text).expect("a map").function;
    assert_eq!(f.scale(), ValueScale::Log);
    assert!((f.srgb_at(10.0)[0] - 0.5).abs() < 1e-12);
    let text = r#"{"UseLogScale": 1, "Points": [0,0,0.5,0.5, 1,1,0.5,0.5], "RGBPoints": [1,0,0,0, 9,1,1,1]}"#;
    assert!(message(text).contains("logarithmic"), "{}", message(text));
}

#[test]
fn what_is_not_understood_is_named() {
    let cases = [
        ("", "line 1"),
        ("[1, 2", "line 1, column 5"),
        ("[]", "an empty list"),
        ("{}", "vacua_transfer_function"),
        ("[3]", "a number"),
        (r#"[{"IndexedColors": [0,0,0]}]"#, "IndexedColors"),
        (r#"[{"RGBPoints": []}]"#, "at least one point"),
        (r#"[{"RGBPoints": [0,0,0]}]"#, "groups of 4"),
        (r#"[{"RGBPoints": [0,0,0,"x"]}]"#, "`RGBPoints`[3]"),
        (r#"[{"RGBPoints": [0,0,0,1e999]}]"#, "out of range"),
        (r#"[{"RGBPoints": [0,0,0,7]}]"#, "outside 0 to 1"),
        (
            r#"[{"RGBPoints": [0,0,0,1], "ColorSpace": "Prolab"}]"#,
            "Prolab",
        ),
        (
            r#"[{"RGBPoints": [0,0,0,1], "UseLogScale": "maybe"}]"#,
            "UseLogScale",
        ),
        (r#"{"vacua_transfer_function": 2}"#, "version 1"),
        (
            r#"{"vacua_transfer_function": 1, "colours": []}"#,
            "`colours`",
        ),
        (
            r#"{"vacua_transfer_function": 1, "colors": [[0,0,0,0]]}"#,
            "`opacities`",
        ),
        (
            r#"{"vacua_transfer_function": 1, "colors": [[0,0,0]], "opacities": []}"#,
            "`colors`[0]",
        ),
        (
            r#"{"vacua_transfer_function": 1, "colors": [[0,0,0,0]], "opacities": [[0,0]], "scale": "cubic"}"#,
            "cubic",
        ),
        (
            r#"{"vacua_transfer_function": 1, "colors": [[0,0,0,0]], "opacities": [[0,2]]}"#,
            "opacity point 0 is 2",
        ),
    ];
    for (text, expected) in cases {
        let message = message(text);
        assert!(message.contains(expected), "{text}: {message}");
    }
    assert!(matches!(
        read(
            r#"{"vacua_transfer_function": 1, "colors": [[0,0,0,0]], "opacities": [[0,0]], "unit_length": 0}"#
        ),
        Err(Problem::TransferFunction(
            TransferFunctionError::UnitLength(_)
        ))
    ));
    let deep = "[".repeat(100_000);
    assert!(message(&deep).contains("recursion"));
}

#[test]
fn files_name_themselves() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = folder.path().join("map.json");
    std::fs::write(&path, "{\n  \"RGBPoints\": [0, 0, 0 0]\n}").expect("writable");
    let error = read_transfer_function(&path, 1.0).unwrap_err().to_string();
    assert!(error.contains("map.json: line 2, column"), "{error}");
}

proptest! {
    #[test]
    fn own_files_read_back_exactly(
        mut values in prop::collection::vec(prop::num::f64::NORMAL, 2..20),
        unit in prop::collection::vec(0.0f64..=1.0, 80),
        unit_length in prop::num::f64::POSITIVE,
    ) {
        values.sort_by(f64::total_cmp);
        let colors: Vec<ColorPoint> = values
            .iter()
            .enumerate()
            .map(|(i, &value)| ColorPoint { value, srgb: [unit[i], unit[i + 20], unit[i + 40]] })
            .collect();
        let opacities: Vec<OpacityPoint> = values
            .iter()
            .enumerate()
            .map(|(i, &value)| OpacityPoint { value, opacity: unit[i + 60] })
            .collect();
        for scale in [ValueScale::Linear, ValueScale::Log] {
            let Ok(f) = TransferFunction::new(colors.clone(), opacities.clone(), unit_length, scale)
            else {
                continue;
            };
            let text = transfer_function_to_json(&f);
            let back = transfer_function_from_json(text.as_bytes(), 1.0).expect("own file");
            prop_assert_eq!(back.function, f);
            prop_assert!(back.notes.is_empty());
        }
    }

    #[test]
    fn mutated_files_never_panic(at in 0usize..PARAVIEW.len(), byte in any::<u8>(), cut in any::<bool>()) {
        let mut text = PARAVIEW.as_bytes().to_vec();
        text[at] = byte;
        if cut {
            text.truncate(at);
        }
        // A change may leave a valid file; only a panic is wrong.
        if let Ok(file) = transfer_function_from_json(&text, 1.0) {
            prop_assert!(file.function.colors().len() < 1 << 17);
        }
    }
}
