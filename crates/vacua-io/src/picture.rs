//! Pictures out: PNG for eyes, EXR for numbers.
//!
//! Both take linear-light premultiplied RGBA. A PNG is 8-bit sRGB, over a background or with
//! straight alpha. An EXR holds the RGBA as it is, in 32-bit float, with depth in channel `Z` (world
//! units along the ray, infinite where nothing was met) and, if given, the cost plane in channel
//! `cost`; nothing in it varies by run, time or number of threads.

use std::io::{BufWriter, Cursor, Error, Seek, Write};
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, SmallVec, Text, WritableImage,
};
use rayon::prelude::*;
use vacua_volume::srgb_from_linear;

use crate::error::{IoError, Problem};
use crate::{is_stream, write_atomically};

/// A finished picture, row by row from the top, pixels from the left.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear-light red, green, blue, premultiplied by alpha, and alpha.
    pub rgba: &'a [[f32; 4]],
    /// Distance to what is seen; infinite where nothing is. World units.
    pub depth: Option<&'a [f32]>,
    /// What each pixel cost: samples or time.
    pub cost: Option<&'a [f32]>,
}

impl Picture<'_> {
    /// Checks that every plane has one entry a pixel, and that there is a pixel.
    fn check(&self) -> Result<(), Problem> {
        let pixels = self.width.saturating_mul(self.height);
        let planes = [
            ("colour", Some(self.rgba.len())),
            ("depth", self.depth.map(<[f32]>::len)),
            ("cost", self.cost.map(<[f32]>::len)),
        ];
        for (plane, len) in planes {
            if let Some(len) = len.filter(|&len| len != pixels || pixels == 0) {
                return Err(Problem::malformed(
                    format!("the picture's {plane} plane"),
                    format!("{} × {} pixels, at least one", self.width, self.height),
                    format!("{len}"),
                ));
            }
        }
        Ok(())
    }
}

/// Writes a picture in the format that the file name ends in: `.png` or `.exr`. A PNG is composed
/// over `background` (linear-light red, green, blue), or keeps its alpha without one; an EXR is
/// written as it is.
///
/// # Errors
/// [`IoError`] for another ending, planes that do not fit, or a file that cannot be written.
pub fn write_picture(
    path: &Path,
    picture: &Picture,
    background: Option<[f32; 3]>,
) -> Result<(), IoError> {
    match PictureFormat::of(path).map_err(|p| p.in_file(path))? {
        PictureFormat::Png => write_png(path, picture, background),
        PictureFormat::Exr => write_exr(path, picture),
    }
}

/// The formats that pictures are written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    /// 8-bit sRGB.
    Png,
    /// 32-bit float, linear light, premultiplied, with depth.
    Exr,
}

impl PictureFormat {
    /// The format that a file name asks for; a PNG for a [stream](is_stream) without an ending.
    ///
    /// # Errors
    /// [`Problem::Unsupported`] if it ends neither in `.png` nor in `.exr`.
    pub fn of(path: &Path) -> Result<Self, Problem> {
        if path.extension().is_none() && is_stream(path) {
            return Ok(Self::Png);
        }
        let extension = path
            .extension()
            .map(|e| e.to_string_lossy().to_lowercase())
            .unwrap_or_default();
        match extension.as_str() {
            "png" => Ok(Self::Png),
            "exr" => Ok(Self::Exr),
            "" => Err(Problem::Unsupported {
                what: "writing a picture to a name without an ending".to_owned(),
                hint: Some("give one that ends in .png or .exr".to_owned()),
            }),
            _ => Err(Problem::Unsupported {
                what: format!("writing a picture as `.{extension}`"),
                hint: Some("give a name that ends in .png or .exr".to_owned()),
            }),
        }
    }
}

/// Writes an 8-bit sRGB PNG, over a background (linear-light red, green, blue) or, without one, with
/// straight alpha.
///
/// # Errors
/// [`IoError`] if the planes do not fit or the file cannot be written.
pub fn write_png(
    path: &Path,
    picture: &Picture,
    background: Option<[f32; 3]>,
) -> Result<(), IoError> {
    picture.check().map_err(|p| p.in_file(path))?;
    let (width, height) = png_size(picture).map_err(|p| p.in_file(path))?;
    let (color, bytes) = match background {
        Some(background) => (png::ColorType::Rgb, opaque_bytes(picture.rgba, background)),
        None => (png::ColorType::Rgba, straight_bytes(picture.rgba)),
    };
    write_atomically(path, |file| {
        let mut encoder = png::Encoder::new(file, width, height);
        encoder.set_color(color);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&bytes)?;
        Ok(writer.finish()?)
    })
}

fn png_size(picture: &Picture) -> Result<(u32, u32), Problem> {
    let side = |n: usize| {
        u32::try_from(n)
            .map_err(|_| Problem::unsupported(format!("a PNG with a side of {n} pixels")))
    };
    Ok((side(picture.width)?, side(picture.height)?))
}

/// One component from linear light to an sRGB byte; what is not a number is black.
fn byte_from_linear(linear: f32) -> u8 {
    (srgb_from_linear(f64::from(linear)).clamp(0.0, 1.0) * 255.0).round() as u8
}

fn opaque_bytes(rgba: &[[f32; 4]], background: [f32; 3]) -> Vec<u8> {
    rgba.par_iter()
        .flat_map_iter(|&[r, g, b, a]| {
            let through = 1.0 - a;
            [
                byte_from_linear(r + through * background[0]),
                byte_from_linear(g + through * background[1]),
                byte_from_linear(b + through * background[2]),
            ]
        })
        .collect()
}

fn straight_bytes(rgba: &[[f32; 4]]) -> Vec<u8> {
    rgba.par_iter()
        .flat_map_iter(|&[r, g, b, a]| {
            let straight = |c: f32| if a > 0.0 { byte_from_linear(c / a) } else { 0 };
            let alpha = (a.clamp(0.0, 1.0) * 255.0).round() as u8;
            [straight(r), straight(g), straight(b), alpha]
        })
        .collect()
}

/// Writes an EXR with the channels `R`, `G`, `B`, `A` and, where given, `Z` (depth) and `cost`.
///
/// # Errors
/// [`IoError`] if the planes do not fit or the file cannot be written.
pub fn write_exr(path: &Path, picture: &Picture) -> Result<(), IoError> {
    picture.check().map_err(|p| p.in_file(path))?;
    write_atomically(path, |file| {
        // In memory first: its table of places is written last, which no pipe takes.
        let mut whole = BufWriter::new(Cursor::new(Vec::new()));
        write_exr_to(&mut whole, picture)?;
        file.write_all(whole.into_inner()?.get_ref())
    })
}

fn write_exr_to<W: Write + Seek>(
    file: &mut BufWriter<W>,
    picture: &Picture,
) -> std::io::Result<()> {
    let channel =
        |name: &str, values: Vec<f32>| AnyChannel::new(Text::from(name), FlatSamples::F32(values));
    let color = |c: usize| picture.rgba.iter().map(|p| p[c]).collect::<Vec<f32>>();
    let mut channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = ["R", "G", "B", "A"]
        .into_iter()
        .enumerate()
        .map(|(c, name)| channel(name, color(c)))
        .collect();
    if let Some(depth) = picture.depth {
        channels.push(channel("Z", depth.to_vec()));
    }
    if let Some(cost) = picture.cost {
        channels.push(channel("cost", cost.to_vec()));
    }
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new(
        (picture.width, picture.height),
        LayerAttributes::default(),
        encoding,
        AnyChannels::sort(channels),
    );
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(file)
        .map_err(|error| match error {
            exr::error::Error::Io(error) => error,
            other => Error::other(other),
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{ReadChannels, ReadLayers, read};

    fn decode_png(path: &Path) -> (png::OutputInfo, Vec<u8>) {
        let file = std::io::BufReader::new(std::fs::File::open(path).expect("was written"));
        let mut reader = png::Decoder::new(file).read_info().expect("a PNG");
        let mut bytes = vec![0; reader.output_buffer_size().expect("small")];
        let info = reader.next_frame(&mut bytes).expect("one frame");
        bytes.truncate(info.buffer_size());
        (info, bytes)
    }

    const RGBA: [[f32; 4]; 6] = [
        [0.0, 0.0, 0.0, 0.0],
        [1.0, 1.0, 1.0, 1.0],
        [0.5, 0.0, 0.0, 0.5],
        [0.214_041_14, 0.214_041_14, 0.214_041_14, 1.0],
        [7.0, -1.0, f32::NAN, 1.0],
        [0.1, 0.2, 0.3, 0.4],
    ];

    fn picture() -> Picture<'static> {
        const DEPTH: [f32; 6] = [f32::INFINITY, 1.0, 2.0, 3.5, 4.0, 1e-30];
        Picture {
            width: 3,
            height: 2,
            rgba: &RGBA,
            depth: Some(&DEPTH),
            cost: None,
        }
    }

    #[test]
    fn png_over_a_background() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.PNG");
        write_picture(&path, &picture(), Some([0.0, 0.0, 1.0])).expect("written");
        let (info, bytes) = decode_png(&path);
        assert_eq!(
            (info.width, info.height, info.color_type),
            (3, 2, png::ColorType::Rgb)
        );
        assert_eq!(&bytes[0..3], [0, 0, 255]);
        assert_eq!(&bytes[3..6], [255, 255, 255]);
        // Half of linear light 1 is sRGB 188.
        assert_eq!(&bytes[6..9], [188, 0, 188]);
        // Linear 0.21404 is sRGB 0.5.
        assert_eq!(&bytes[9..12], [128, 128, 128]);
        assert_eq!(&bytes[12..15], [255, 0, 0]);
    }

    #[test]
    fn png_with_straight_alpha() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.png");
        write_picture(&path, &picture(), None).expect("written");
        let (info, bytes) = decode_png(&path);
        assert_eq!(info.color_type, png::ColorType::Rgba);
        assert_eq!(&bytes[0..4], [0, 0, 0, 0]);
        assert_eq!(&bytes[8..12], [255, 0, 0, 128]);
    }

    #[test]
    fn exr_keeps_every_bit_and_nothing_else() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let (a, b) = (folder.path().join("a.exr"), folder.path().join("b.exr"));
        let cost = [1.0f32, 2.0, 3.0, 4.0, 5.0, 6.0];
        let with_cost = Picture {
            cost: Some(&cost),
            ..picture()
        };
        for (path, picture) in [(&a, picture()), (&b, with_cost)] {
            write_picture(path, &picture, Some([1.0; 3])).expect("written");
            let image = read()
                .no_deep_data()
                .largest_resolution_level()
                .all_channels()
                .first_valid_layer()
                .all_attributes()
                .from_file(path)
                .expect("an EXR");
            let mut found: Vec<String> = Vec::new();
            for channel in &image.layer_data.channel_data.list {
                let name = channel.name.to_string();
                let FlatSamples::F32(values) = &channel.sample_data else {
                    panic!("{name} is not f32");
                };
                let expected: Vec<f32> = match name.as_str() {
                    "Z" => picture.depth.expect("given").to_vec(),
                    "cost" => cost.to_vec(),
                    c => {
                        let c = "RGBA".find(c).expect("a colour channel");
                        RGBA.iter().map(|p| p[c]).collect()
                    }
                };
                let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(values), bits(&expected), "{name}");
                found.push(name);
            }
            let expected = if picture.cost.is_some() {
                "A,B,G,R,Z,cost"
            } else {
                "A,B,G,R,Z"
            };
            assert_eq!(found.join(","), expected);
        }
        let again = folder.path().join("again.exr");
        write_exr(&again, &picture()).expect("written");
        assert_eq!(
            std::fs::read(&a).expect("there"),
            std::fs::read(&again).expect("there")
        );
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let short = Picture {
            height: 3,
            ..picture()
        };
        for name in ["a.png", "a.exr"] {
            let error = write_picture(&folder.path().join(name), &short, None).unwrap_err();
            assert!(error.to_string().contains("colour plane"), "{error}");
        }
        let error = write_picture(&folder.path().join("a.jpg"), &picture(), None).unwrap_err();
        assert!(error.to_string().contains(".jpg"), "{error}");
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("listable").count(),
            0
        );
    }
}
