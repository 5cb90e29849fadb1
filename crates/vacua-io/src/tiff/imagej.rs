//! What ImageJ and Fiji write into the description of the first page: `key=value` lines.
//!
//! `images` are `channels × slices × frames`, channels fastest. `XResolution` and `YResolution` are
//! pixels a unit, `spacing` is the distance of slices. A stack above 4 GB has one directory only;
//! its other images follow the first without one.
//! Source: ImageJ's `ij.io.TiffEncoder`, `ij.io.FileOpener` and `ij.io.FileSaver`.

use super::arrangement::Arrangement;
use crate::decode::shown;
use crate::error::Problem;
use crate::units::converted;

/// Whether a description is ImageJ's.
pub(super) fn is_imagej(description: &str) -> bool {
    description.starts_with("ImageJ=")
}

/// The lines of a description.
pub(super) struct Description<'a>(&'a str);

impl<'a> Description<'a> {
    /// A description that [`is_imagej`].
    pub fn new(text: &'a str) -> Self {
        Self(text)
    }

    fn get(&self, key: &str) -> Option<&'a str> {
        self.0
            .lines()
            .filter_map(|line| line.split_once('='))
            .find(|(k, _)| *k == key)
            .map(|(_, value)| value.trim())
            .filter(|value| !value.is_empty())
    }

    fn wrong(key: &str, expected: impl Into<String>, found: &str) -> Problem {
        Problem::malformed(
            format!("ImageJ's `{key}`"),
            expected,
            shown(found.as_bytes()),
        )
    }

    fn count(&self, key: &str) -> Result<Option<usize>, Problem> {
        let parse = |text: &str| {
            text.parse()
                .ok()
                .filter(|&n: &usize| n > 0)
                .ok_or_else(|| Self::wrong(key, "a number of pages", text))
        };
        self.get(key).map(parse).transpose()
    }

    /// A distance or duration: finite and not zero. ImageJ takes negative ones as positive too.
    fn distance(&self, key: &str) -> Result<Option<f64>, Problem> {
        let parse = |text: &str| {
            text.parse::<f64>()
                .ok()
                .map(f64::abs)
                .filter(|n| n.is_finite() && *n > 0.0)
                .ok_or_else(|| Self::wrong(key, "a number that is finite and not zero", text))
        };
        self.get(key).map(parse).transpose()
    }

    fn unit(&self, key: &str) -> Option<String> {
        // The micro sign comes as an escape, or in Latin-1.
        let plain = |text: &str| text.replace("\\u00B5", "µ").replace('\u{FFFD}', "µ");
        self.get(key)
            .filter(|unit| !matches!(*unit, "pixel" | "pixels"))
            .map(plain)
    }

    /// Images that the file holds, whether each has a directory or not.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it is no number.
    pub fn images(&self) -> Result<Option<usize>, Problem> {
        self.count("images")
    }

    /// How `num_images` images are arranged. `resolution` are pixels a unit, across and down.
    ///
    /// # Errors
    /// [`Problem`] naming the key that is wrong or contradicts another.
    pub fn arrange(
        &self,
        num_images: usize,
        resolution: [Option<f64>; 2],
    ) -> Result<Arrangement, Problem> {
        if let Some(images) = self.images()?.filter(|&images| images != num_images) {
            return Err(Self::wrong(
                "images",
                format!("{num_images}, as many as the file has pages"),
                &images.to_string(),
            ));
        }
        let counts = [
            self.count("channels")?,
            self.count("slices")?,
            self.count("frames")?,
        ];
        let [channels, slices, frames] = match counts {
            [None, None, None] => [1, num_images, 1],
            counts => counts.map(|n| n.unwrap_or(1)),
        };
        let product = channels
            .checked_mul(slices)
            .and_then(|n| n.checked_mul(frames));
        if product != Some(num_images) {
            return Err(Problem::malformed(
                "ImageJ's `channels`, `slices` and `frames`",
                format!("a product of {num_images}, as many as there are images"),
                format!("{channels} × {slices} × {frames}"),
            ));
        }
        let mut notes = Vec::new();
        let mut per_pixel = |axis: usize, name: &str| {
            let inverse = resolution[axis].map(f64::recip);
            let good = inverse.filter(|n| n.is_finite() && *n > 0.0);
            if inverse.is_some() && good.is_none() {
                notes.push(format!("{name} is no number of pixels: it was ignored"));
            }
            good
        };
        let (x, y) = (per_pixel(0, "XResolution"), per_pixel(1, "YResolution"));
        let z = self.distance("spacing")?;
        let unit = self.unit("unit");
        let in_unit = |length: Option<f64>, key: &str| match (length, self.unit(key), &unit) {
            (Some(length), Some(own), Some(unit)) => converted(length, &own, unit).map(Some),
            _ => Ok(length),
        };
        let spacing = [x, in_unit(y, "yunit")?, in_unit(z, "zunit")?];
        if self.get("cf").is_some() {
            notes.push("numbers are as stored, without ImageJ's calibration".to_owned());
        }
        let place = |i: usize| {
            let (z, c, t) = (i % slices, i / slices % channels, i / slices / channels);
            c + channels * (z + slices * t)
        };
        Ok(Arrangement {
            slices,
            channels,
            frames,
            pages: (0..num_images).map(place).collect(),
            spacing,
            unit,
            channel_names: Vec::new(),
            interval: self.distance("finterval").unwrap_or_default(),
            notes,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrange(lines: &str, num_images: usize) -> Result<Arrangement, Problem> {
        Description::new(&format!("ImageJ=1.54f\n{lines}"))
            .arrange(num_images, [Some(4.0), Some(2.0)])
    }

    #[test]
    fn channels_are_fastest_and_frames_slowest() {
        let found = arrange("images=12\nchannels=2\nslices=3\nframes=2\n", 12).expect("legal");
        assert_eq!((found.slices, found.channels, found.frames), (3, 2, 2));
        assert_eq!(found.pages[found.volume(0, 0)], [0, 2, 4]);
        assert_eq!(found.pages[found.volume(1, 0)], [1, 3, 5]);
        assert_eq!(found.pages[found.volume(1, 1)], [7, 9, 11]);
        let plain = arrange("images=5\n", 5).expect("legal");
        assert_eq!((plain.slices, plain.channels, plain.frames), (5, 1, 1));
    }

    #[test]
    fn spacing_is_in_one_unit() {
        let lines = "images=2\nslices=2\nspacing=-1500\nunit=\\u00B5m\nzunit=nm\nfinterval=0.5";
        let found = arrange(lines, 2).expect("legal");
        assert_eq!(found.unit.as_deref(), Some("µm"));
        let [x, y, z] = found.spacing.map(|s| s.expect("said"));
        assert_eq!((x, y), (0.25, 0.5));
        assert!((z - 1.5).abs() < 1e-12, "{z}");
        assert_eq!(found.interval, Some(0.5));
    }

    #[test]
    fn wrong_numbers_are_named() {
        for (lines, part) in [
            ("images=3", "images"),
            ("images=x", "images"),
            ("images=4\nslices=3", "1 × 3 × 1"),
            ("images=4\nslices=4\nspacing=NaN", "spacing"),
            ("images=4\nslices=4\nspacing=0", "spacing"),
            ("slices=18446744073709551615\nframes=9", "product"),
            ("slices=4\nspacing=1\nunit=um\nzunit=furlong", "furlong"),
        ] {
            let error = arrange(lines, 4).expect_err(lines).to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
