//! Which way the axes of the world point in a body: what medical files say of their coordinates.

use std::fmt;

use glam::DVec3;

/// The anatomical frame of a dataset's world coordinates.
///
/// # The rule
/// World coordinates are those of the file, in its own frame: nothing is mirrored when a file is
/// read, rendered or sampled. The frame is a label beside them. Readers set it: NIfTI is
/// [`Ras`](Self::Ras) wherever its header places the voxels in a body (`sform` or `qform`), NRRD is
/// what its field `space` says, MetaImage is [`Lps`](Self::Lps), as ITK takes it. All else is
/// [`Unlabelled`](Self::Unlabelled). Writers keep both or convert: NRRD writes coordinates as they
/// are and names their frame, MetaImage turns labelled ones into LPS, and both leave unlabelled
/// coordinates alone. Only positions are turned; components of vector fields stay as they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum WorldFrame {
    /// No file said what the axes mean.
    #[default]
    Unlabelled,
    /// x to the right, y to the front (anterior), z up (superior).
    Ras,
    /// x to the left, y to the front, z up.
    Las,
    /// x to the left, y to the back (posterior), z up.
    Lps,
}

impl WorldFrame {
    /// The letters of the directions in which x, y and z grow; `None` without a label.
    pub fn letters(self) -> Option<&'static str> {
        match self {
            Self::Unlabelled => None,
            Self::Ras => Some("RAS"),
            Self::Las => Some("LAS"),
            Self::Lps => Some("LPS"),
        }
    }

    /// What world coordinates are multiplied by, axis by axis, to turn them into those of another
    /// frame: 1 or −1 each. `None` if either has no label.
    pub fn signs_to(self, other: Self) -> Option<DVec3> {
        let from_ras = |frame| {
            Some(match frame {
                Self::Unlabelled => return None,
                Self::Ras => DVec3::ONE,
                Self::Las => DVec3::new(-1.0, 1.0, 1.0),
                Self::Lps => DVec3::new(-1.0, -1.0, 1.0),
            })
        };
        Some(from_ras(self)? * from_ras(other)?)
    }
}

impl fmt::Display for WorldFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.letters().unwrap_or("unlabelled"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_turn_into_each_other_and_back() {
        use WorldFrame::{Las, Lps, Ras, Unlabelled};
        assert_eq!(Ras.signs_to(Lps), Some(DVec3::new(-1.0, -1.0, 1.0)));
        assert_eq!(Las.signs_to(Lps), Some(DVec3::new(1.0, -1.0, 1.0)));
        for from in [Ras, Las, Lps] {
            assert_eq!(from.signs_to(from), Some(DVec3::ONE));
            assert_eq!(from.signs_to(Unlabelled), None);
            assert_eq!(Unlabelled.signs_to(from), None);
            for to in [Ras, Las, Lps] {
                assert_eq!(from.signs_to(to), to.signs_to(from));
            }
        }
    }
}
