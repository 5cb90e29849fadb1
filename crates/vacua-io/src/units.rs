//! Units of length, as imaging files name them.

use crate::error::Problem;

/// A unit of length: so many times a power of ten of metres.
fn unit(name: &str) -> Option<(f64, i32)> {
    Some(match name {
        "pm" | "picometer" | "picometre" => (1.0, -12),
        "Å" | "A" | "angstrom" => (1.0, -10),
        "nm" | "nanometer" | "nanometre" => (1.0, -9),
        "µm" | "μm" | "um" | "micron" | "microns" | "micrometer" | "micrometre" => (1.0, -6),
        "mm" | "millimeter" | "millimetre" => (1.0, -3),
        "cm" | "centimeter" | "centimetre" => (1.0, -2),
        "m" | "meter" | "metre" => (1.0, 0),
        "km" | "kilometer" | "kilometre" => (1.0, 3),
        "in" | "inch" | "inches" => (254.0, -4),
        _ => return None,
    })
}

/// A length given in one unit, in another.
///
/// # Errors
/// [`Problem::Unsupported`] if they differ and one of them is not known.
pub(crate) fn converted(length: f64, from: &str, to: &str) -> Result<f64, Problem> {
    if from == to {
        return Ok(length);
    }
    let Some(((many, power), (many_to, power_to))) = unit(from).zip(unit(to)) else {
        return Err(Problem::unsupported_but(
            format!("a spacing in `{from}` beside one in `{to}`"),
            "units of length are pm, Å, nm, µm, mm, cm, m, km and inch",
        ));
    };
    // Powers of ten up to here are exact, their inverses are not.
    let ten = 10f64.powi((power - power_to).abs());
    Ok(if power < power_to {
        length * many / (ten * many_to)
    } else {
        length * ten * many / many_to
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_converted_without_rounding() {
        for (length, from, to, expected) in [
            (0.5, "micrometer", "nm", 500.0),
            (130.0, "nm", "µm", 0.13),
            (2.0, "inch", "mm", 50.8),
            (25.4, "mm", "in", 1.0),
            (3.0, "parsec", "parsec", 3.0),
        ] {
            assert_eq!(converted(length, from, to).ok(), Some(expected), "{from}");
        }
        assert!(converted(1.0, "mm", "parsec").is_err());
    }
}
