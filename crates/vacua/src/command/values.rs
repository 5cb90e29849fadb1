//! What people type, turned into values: sizes, points, ranges, colours, cameras. Each parser takes
//! the text of one flag and either understands all of it or says what it expected.

use std::str::FromStr;

use glam::DVec3;
use vacua_pack::DetailLevel;
use vacua_volume::{OpacityPoint, ValueRange};

/// Why the text of a flag was not understood.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("expected {expected}, found `{found}`")]
pub struct ValueError {
    expected: String,
    found: String,
}

fn wrong(expected: impl Into<String>, found: &str) -> ValueError {
    ValueError {
        expected: expected.into(),
        found: found.to_owned(),
    }
}

/// One finite number.
fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

/// `N` finite numbers separated by commas.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let mut out = [0.0; N];
    let mut parts = text.split(',');
    for slot in &mut out {
        *slot = number(parts.next()?)?;
    }
    parts.next().is_none().then_some(out)
}

/// `N` whole numbers separated by `x`.
fn sizes<const N: usize>(text: &str) -> Option<[usize; N]> {
    let mut out = [0; N];
    let mut parts = text.split(['x', 'X', '×']);
    for slot in &mut out {
        *slot = parts.next()?.trim().parse().ok().filter(|&n| n > 0)?;
    }
    parts.next().is_none().then_some(out)
}

/// `XxYxZ`, all positive.
pub fn dimensions(text: &str) -> Result<[usize; 3], ValueError> {
    sizes(text).ok_or_else(|| wrong("three sizes such as 256x256x128", text))
}

/// Largest side of a picture, in pixels.
const MAX_SIDE: usize = 1 << 16;

/// `WxH`, both from 1 to 65,536.
pub fn picture_size(text: &str) -> Result<[usize; 2], ValueError> {
    sizes(text)
        .filter(|size: &[usize; 2]| size.iter().all(|&n| n <= MAX_SIDE))
        .ok_or_else(|| {
            wrong(
                format!("width and height in pixels such as 1024x768, at most {MAX_SIDE}"),
                text,
            )
        })
}

/// `X,Y,Z`.
pub fn triple(text: &str) -> Result<[f64; 3], ValueError> {
    numbers(text).ok_or_else(|| wrong("three numbers such as 1,0.5,2", text))
}

/// A positive number.
pub fn positive(text: &str) -> Result<f64, ValueError> {
    number(text)
        .filter(|&v| v > 0.0)
        .ok_or_else(|| wrong("a positive number", text))
}

/// `LO,HI` with LO ≤ HI.
pub fn range(text: &str) -> Result<ValueRange, ValueError> {
    numbers(text)
        .filter(|[lo, hi]| lo <= hi)
        .map(|[lo, hi]| ValueRange { lo, hi })
        .ok_or_else(|| wrong("a lower and an upper value such as 0,255", text))
}

/// Opacity points `v:a,v:a,…`, a from 0 to 1, in order of value.
#[derive(Clone, Debug, PartialEq)]
pub struct OpacityList(pub Vec<OpacityPoint>);

impl FromStr for OpacityList {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let mut points: Vec<OpacityPoint> = Vec::new();
        for part in text.split(',') {
            let point = part
                .rsplit_once(':')
                .and_then(|(value, opacity)| {
                    Some(OpacityPoint {
                        value: number(value)?,
                        opacity: number(opacity).filter(|a| (0.0..=1.0).contains(a))?,
                    })
                })
                .ok_or_else(|| {
                    wrong(
                        "value:opacity pairs such as 0:0,100:0.5, opacities from 0 to 1",
                        part,
                    )
                })?;
            if points.last().is_some_and(|last| last.value > point.value) {
                return Err(wrong("values in rising order", text));
            }
            points.push(point);
        }
        Ok(Self(points))
    }
}

/// A field by name, or `#0` by number.
pub fn field(text: &str) -> Result<vacua_volume::FieldChoice, ValueError> {
    use vacua_volume::FieldChoice;
    match text.strip_prefix('#') {
        Some(index) => index
            .parse()
            .map(FieldChoice::Index)
            .map_err(|_| wrong("a field name, or its number such as #0", text)),
        None => Ok(FieldChoice::Name(text.to_owned())),
    }
}

/// A number of bytes: `800M`, `2GiB` (powers of 1024), `2GB` (powers of 1000), or plain.
pub fn num_bytes(text: &str) -> Result<u64, ValueError> {
    let expected = || wrong("a number of bytes such as 2GiB or 800M", text);
    let trimmed = text.trim();
    let digits_end = trimmed
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .unwrap_or(trimmed.len());
    let (digits, unit) = trimmed.split_at(digits_end);
    let value: f64 = digits.parse().map_err(|_| expected())?;
    let unit = unit.trim().to_ascii_lowercase();
    let (prefix, base) = match unit.strip_suffix("ib") {
        Some(prefix) => (prefix, 1024.0f64),
        None => match unit.strip_suffix('b') {
            Some(prefix) => (prefix, 1000.0),
            None => (unit.as_str(), 1024.0),
        },
    };
    let power = match prefix {
        "" => 0,
        "k" => 1,
        "m" => 2,
        "g" => 3,
        "t" => 4,
        _ => return Err(expected()),
    };
    Ok((value * base.powi(power)) as u64)
}

/// A level of detail, or `exact`.
pub fn detail(text: &str) -> Result<vacua::Detail, ValueError> {
    use vacua::Detail;
    let levels = DetailLevel::ALL.map(Detail::Level);
    let mut all = levels.into_iter().chain([Detail::Exact]);
    all.find(|detail| detail.name() == text)
        .ok_or_else(|| wrong("submesh, multileaf, leaf or exact", text))
}

/// A component by number, or `mag`.
pub fn component(text: &str) -> Result<vacua_volume::ComponentChoice, ValueError> {
    use vacua_volume::ComponentChoice;
    match text {
        "mag" | "magnitude" => Ok(ComponentChoice::Magnitude),
        _ => text
            .parse()
            .map(ComponentChoice::Index)
            .map_err(|_| wrong("a component number counted from 0, or `mag`", text)),
    }
}

/// A colour behind the picture, or none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// No colour: the picture keeps its alpha.
    Transparent,
    /// sRGB-encoded red, green, blue in `0..=1`.
    Color([f32; 3]),
}

impl FromStr for Background {
    type Err = ValueError;

    /// Reads every CSS colour: `black`, `#336699`, `rgb(10 20 30)`, `transparent` …
    fn from_str(text: &str) -> Result<Self, ValueError> {
        let color = csscolorparser::parse(text)
            .map_err(|_| wrong("a colour such as white, #336699 or transparent", text))?;
        if color.a == 0.0 {
            return Ok(Self::Transparent);
        }
        if color.a < 1.0 {
            return Err(wrong("an opaque colour, or transparent", text));
        }
        Ok(Self::Color([color.r, color.g, color.b]))
    }
}

/// How a camera sees: by an angle or by a height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Perspective with this vertical field of view, degrees.
    Perspective(f64),
    /// Orthographic with this height of the view, world units.
    Orthographic(f64),
}

/// Where a camera stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stand {
    /// Eye, point looked at and up direction, world units.
    Place {
        /// Where the eye is.
        eye: DVec3,
        /// What it looks at; the centre of the data if not said.
        at: Option<DVec3>,
        /// What is up; y if not said.
        up: Option<DVec3>,
    },
    /// On a sphere around the data, far enough to see all of it: azimuth and elevation, degrees.
    Orbit(f64, f64),
}

/// A camera as `--camera` describes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraChoice {
    /// Where it stands.
    pub stand: Stand,
    /// How it sees; perspective, framing the data, if not said.
    pub projection: Option<Projection>,
}

impl FromStr for CameraChoice {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        const EXPECTED: &str = "eye=x,y,z;at=x,y,z;up=x,y,z;fov=degrees, with ortho=height instead of fov, or orbit=azimuth,elevation instead of eye, at and up";
        let (mut eye, mut at, mut up, mut orbit, mut fov, mut ortho) =
            (None, None, None, None, None, None);
        for part in text.split(';').filter(|part| !part.trim().is_empty()) {
            let (key, value) = part.split_once('=').ok_or_else(|| wrong(EXPECTED, part))?;
            let point = || {
                numbers(value)
                    .map(DVec3::from)
                    .ok_or_else(|| wrong("three numbers x,y,z", part))
            };
            match key.trim() {
                "eye" => eye = Some(point()?),
                "at" => at = Some(point()?),
                "up" => up = Some(point()?),
                "orbit" => {
                    let angles: [f64; 2] = numbers(value)
                        .ok_or_else(|| wrong("azimuth,elevation in degrees", part))?;
                    orbit = Some(angles);
                }
                "fov" => {
                    let degrees = number(value).filter(|d| *d > 0.0 && *d < 180.0);
                    fov =
                        Some(degrees.ok_or_else(|| {
                            wrong("a field of view between 0 and 180 degrees", part)
                        })?);
                }
                "ortho" => {
                    ortho = Some(positive(value).map_err(|_| wrong("a positive height", part))?)
                }
                _ => return Err(wrong(EXPECTED, part)),
            }
        }
        let stand = match (eye, orbit) {
            (Some(eye), None) if at != Some(eye) => Stand::Place { eye, at, up },
            (Some(_), None) => return Err(wrong("an eye that is not at what it looks at", text)),
            (None, Some([azimuth, elevation])) if at.is_none() && up.is_none() => {
                Stand::Orbit(azimuth, elevation)
            }
            _ => return Err(wrong(EXPECTED, text)),
        };
        if up.is_some_and(|up| up == DVec3::ZERO) {
            return Err(wrong("an up direction with a length", text));
        }
        let projection = match (fov, ortho) {
            (None, None) => None,
            (Some(degrees), None) => Some(Projection::Perspective(degrees)),
            (None, Some(height)) => Some(Projection::Orthographic(height)),
            (Some(_), Some(_)) => return Err(wrong("either fov or ortho", text)),
        };
        Ok(Self { stand, projection })
    }
}

/// A clip plane: a point on it, and the normal that points to the side that stays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipChoice {
    /// A point on the plane, world units.
    pub point: DVec3,
    /// Points to the side that stays; any length but zero.
    pub normal: DVec3,
}

impl FromStr for ClipChoice {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        text.split_once(';')
            .and_then(|(point, normal)| {
                Some(Self {
                    point: numbers(point).map(DVec3::from)?,
                    normal: numbers(normal)
                        .map(DVec3::from)
                        .filter(|n| n.length() > 0.0)?,
                })
            })
            .ok_or_else(|| wrong("a point and a normal such as 0,0,0;1,0,0", text))
    }
}

/// A world box `x0,x1,y0,y1,z0,z1`.
pub fn region(text: &str) -> Result<vacua_volume::Bounds, ValueError> {
    numbers(text)
        .filter(|[x0, x1, y0, y1, z0, z1]| x0 < x1 && y0 < y1 && z0 < z1)
        .map(|[x0, x1, y0, y1, z0, z1]| vacua_volume::Bounds {
            lo: DVec3::new(x0, y0, z0),
            hi: DVec3::new(x1, y1, z1),
        })
        .ok_or_else(|| wrong("a box x0,x1,y0,y1,z0,z1 with x0 < x1 and so on", text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_have_units() {
        assert_eq!(num_bytes("2GiB"), Ok(2 << 30));
        assert_eq!(num_bytes("8G"), Ok(8 << 30));
        assert_eq!(num_bytes("1.5 GB"), Ok(1_500_000_000));
        assert_eq!(num_bytes("640k"), Ok(640 << 10));
        assert_eq!(num_bytes("17"), Ok(17));
        for bad in ["", "G", "-1G", "2X", "1..2"] {
            assert!(num_bytes(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_and_ranges() {
        assert_eq!(dimensions("3x4x5"), Ok([3, 4, 5]));
        for bad in ["3x4", "3x4x5x6", "3x0x5", "axbxc", "", "3x-4x5"] {
            assert!(dimensions(bad).is_err(), "{bad}");
        }
        assert_eq!(picture_size("640x480"), Ok([640, 480]));
        assert!(picture_size("640x99999999").is_err());
        assert_eq!(range("-1,2.5"), Ok(ValueRange { lo: -1.0, hi: 2.5 }));
        for bad in ["2,1", "1", "1,2,3", "nan,1", "0,inf"] {
            assert!(range(bad).is_err(), "{bad}");
        }
        assert!(region("0,1,0,1,0,1").is_ok());
        assert!(region("0,1,0,1,1,0").is_err());
    }

    #[test]
    fn opacities() {
        let list: OpacityList = "-1e-3:0, 5:0.25,5:1".parse().expect("three points");
        assert_eq!(list.0.len(), 3);
        assert_eq!(list.0[1].opacity, 0.25);
        for bad in ["", "5", "5:2", "5:-1", "5:0.1,4:0.1", "5:nan"] {
            assert!(bad.parse::<OpacityList>().is_err(), "{bad}");
        }
    }

    #[test]
    fn colors() {
        assert_eq!("white".parse(), Ok(Background::Color([1.0; 3])));
        assert_eq!("transparent".parse(), Ok(Background::Transparent));
        assert_eq!("#f00".parse(), Ok(Background::Color([1.0, 0.0, 0.0])));
        assert!("#ff000080".parse::<Background>().is_err());
        assert!("nocolor".parse::<Background>().is_err());
    }

    #[test]
    fn cameras() {
        let camera: CameraChoice = "eye=1,2,3;at=0,0,0;up=0,0,1;fov=40".parse().expect("whole");
        assert_eq!(camera.projection, Some(Projection::Perspective(40.0)));
        let camera: CameraChoice = "orbit=30,20;ortho=2".parse().expect("orbit");
        assert_eq!(camera.stand, Stand::Orbit(30.0, 20.0));
        assert_eq!(camera.projection, Some(Projection::Orthographic(2.0)));
        for bad in [
            "",
            "eye=1,2",
            "at=1,2,3",
            "eye=1,2,3;orbit=3,4",
            "orbit=3,4;at=1,1,1",
            "orbit=3,4;fov=40;ortho=3",
            "eye=1,2,3;fov=180",
            "eye=1,2,3;roll=4",
            "eye=1,2,3;at=1,2,3",
            "eye=1,2,3;up=0,0,0",
            "orbit=3,4;ortho=0",
        ] {
            assert!(bad.parse::<CameraChoice>().is_err(), "{bad}");
        }
    }

    #[test]
    fn planes_and_names() {
        let plane: ClipChoice = "0,0,1;0,0,-2".parse().expect("a plane");
        assert_eq!(plane.normal.z, -2.0);
        for bad in ["0,0,1", "0,0,1;0,0,0", "0,0;1,1,1"] {
            assert!(bad.parse::<ClipChoice>().is_err(), "{bad}");
        }
        assert_eq!(field("#2"), Ok(vacua_volume::FieldChoice::Index(2)));
        assert!(field("#x").is_err());
        assert_eq!(
            component("mag"),
            Ok(vacua_volume::ComponentChoice::Magnitude)
        );
        assert!(component("-1").is_err());
    }
}
