//! Extents: the inclusive boxes of point indices by which VTK places pieces in a whole.

use rayon::prelude::*;
use vacua_volume::{Association, GridError};

use super::ghost::is_duplicate;
use crate::error::Problem;

/// Points `lo..=hi` along each axis; cells `lo..hi`. Any corner fits an `i32`, as in VTK.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Extent {
    /// First point index along each axis.
    pub lo: [i64; 3],
    /// Last point index along each axis.
    pub hi: [i64; 3],
}

impl Extent {
    /// The extent of a grid with `points` a side that starts at zero.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if a side does not fit an `i32`.
    pub fn of_points(place: &str, points: [u64; 3]) -> Result<Self, Problem> {
        let mut hi = [0; 3];
        for (hi, n) in hi.iter_mut().zip(points) {
            *hi = i32::try_from(n)
                .map(|n| i64::from(n) - 1)
                .map_err(|_| Problem::malformed(place, "dimensions below 2³¹", n.to_string()))?;
        }
        Ok(Self { lo: [0; 3], hi })
    }

    /// Reads `x0 x1 y0 y1 z0 z1`.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if these are not six 32-bit integers.
    pub fn parse(place: &str, text: &str) -> Result<Self, Problem> {
        let numbers: Option<Vec<i32>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[x0, x1, y0, y1, z0, z1]) => Ok(Self {
                lo: [x0, y0, z0].map(i64::from),
                hi: [x1, y1, z1].map(i64::from),
            }),
            _ => Err(Problem::malformed(
                place,
                "an extent of six 32-bit integers",
                format!("`{}`", text.chars().take(80).collect::<String>()),
            )),
        }
    }

    /// Whether there is no point in it.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|axis| self.hi[axis] < self.lo[axis])
    }

    /// Points a side; 0 where it is empty.
    pub fn points(&self) -> [usize; 3] {
        [0, 1, 2].map(|axis| usize::try_from(self.hi[axis] - self.lo[axis] + 1).unwrap_or(0))
    }

    /// Points or cells a side.
    pub fn size(&self, association: Association) -> [usize; 3] {
        match association {
            Association::Point => self.points(),
            Association::Cell => self.points().map(|n| n.saturating_sub(1)),
        }
    }

    /// Number of points or cells.
    ///
    /// # Errors
    /// [`GridError::TooLarge`] if that does not fit the address space.
    pub fn count(&self, association: Association) -> Result<usize, Problem> {
        let [nx, ny, nz] = self.size(association);
        nx.checked_mul(ny)
            .and_then(|n| n.checked_mul(nz))
            .ok_or_else(|| GridError::TooLarge(nx, ny, nz).into())
    }

    /// Refuses a grid without a cell along some axis.
    ///
    /// # Errors
    /// [`GridError::Flat`].
    pub fn refuse_flat(&self) -> Result<(), Problem> {
        let [nx, ny, nz] = self.points();
        if nx < 2 || ny < 2 || nz < 2 {
            return Err(GridError::Flat(nx, ny, nz).into());
        }
        Ok(())
    }

    /// Whether another extent lies within this one.
    pub fn contains(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.lo[axis] <= other.lo[axis] && other.hi[axis] <= self.hi[axis])
    }

    /// The smallest extent around both.
    pub fn union(&self, other: &Self) -> Self {
        let pick = |f: fn(i64, i64) -> i64, a: [i64; 3], b: [i64; 3]| {
            [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
        };
        Self {
            lo: pick(i64::min, self.lo, other.lo),
            hi: pick(i64::max, self.hi, other.hi),
        }
    }

    /// What is left of the cells of this extent without those of another: at most six boxes.
    fn without(mut self, other: &Self, rest: &mut Vec<Self>) {
        let apart =
            (0..3).any(|axis| other.hi[axis] <= self.lo[axis] || self.hi[axis] <= other.lo[axis]);
        if apart {
            rest.push(self);
            return;
        }
        for axis in 0..3 {
            if self.lo[axis] < other.lo[axis] {
                let mut below = self;
                below.hi[axis] = other.lo[axis];
                rest.push(below);
                self.lo[axis] = other.lo[axis];
            }
            if other.hi[axis] < self.hi[axis] {
                let mut above = self;
                above.lo[axis] = other.hi[axis];
                rest.push(above);
                self.hi[axis] = other.hi[axis];
            }
        }
    }
}

impl std::fmt::Display for Extent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([x0, y0, z0], [x1, y1, z1]) = (self.lo, self.hi);
        write!(f, "{x0} {x1} {y0} {y1} {z0} {z1}")
    }
}

/// Boxes that a cover may be cut into before it is refused as no decomposition that anyone makes.
const MAX_FRAGMENTS: usize = 1 << 16;

/// Checks that pieces lie in the whole and that every cell of the whole is in some piece.
/// Cost: pieces × boxes left uncovered, no memory a cell.
///
/// # Errors
/// [`Problem::Malformed`] naming the first piece outside or the first box uncovered.
pub(crate) fn check_cover(whole: &Extent, pieces: &[Extent]) -> Result<(), Problem> {
    for piece in pieces {
        if !whole.contains(piece) {
            return Err(Problem::malformed(
                "the extents of the pieces",
                format!("pieces within the whole extent {whole}"),
                format!("a piece {piece}"),
            ));
        }
    }
    let mut uncovered = vec![*whole];
    for piece in pieces {
        let mut rest = Vec::with_capacity(uncovered.len());
        for part in uncovered {
            part.without(piece, &mut rest);
        }
        if rest.len() > MAX_FRAGMENTS {
            return Err(Problem::unsupported(
                "a grid cut into pieces as irregularly as this one",
            ));
        }
        uncovered = rest;
    }
    match uncovered.first() {
        None => Ok(()),
        Some(gap) => Err(Problem::malformed(
            "the extents of the pieces",
            format!("pieces that cover the whole extent {whole}"),
            format!("no piece that covers {gap}"),
        )),
    }
}

/// Where a piece lies in a whole, in points or cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placement {
    /// Points or cells a side of the whole.
    pub whole: [usize; 3],
    /// Points or cells a side of the piece.
    pub piece: [usize; 3],
    /// Position of the piece's first point or cell in the whole.
    pub offset: [usize; 3],
}

impl Placement {
    /// Where `piece` lies in `whole`, which contains it.
    pub fn new(whole: &Extent, piece: &Extent, association: Association) -> Self {
        Self {
            whole: whole.size(association),
            piece: piece.size(association),
            offset: [0, 1, 2]
                .map(|axis| usize::try_from(piece.lo[axis] - whole.lo[axis]).unwrap_or(0)),
        }
    }

    /// Copies the tuples of a piece to their places, row by row; without those that ghost flags
    /// (one a tuple of the piece), if given, call duplicates.
    pub fn scatter(&self, to: &mut [u8], from: &[u8], tuple_bytes: usize, flags: Option<&[u8]>) {
        let [wx, wy, _] = self.whole;
        let [px, py, pz] = self.piece;
        let [ox, oy, oz] = self.offset;
        if px * py * pz == 0 {
            return;
        }
        let slab_bytes = wx * wy * tuple_bytes;
        to.par_chunks_mut(slab_bytes)
            .skip(oz)
            .take(pz)
            .enumerate()
            .for_each(|(z, slab)| {
                for y in 0..py {
                    let source = px * (y + py * z);
                    let target = ox + wx * (y + oy);
                    let row = &from[source * tuple_bytes..][..px * tuple_bytes];
                    let place = &mut slab[target * tuple_bytes..][..px * tuple_bytes];
                    match flags {
                        None => place.copy_from_slice(row),
                        Some(flags) => {
                            for x in (0..px).filter(|x| !is_duplicate(flags[source + x])) {
                                let tuple = x * tuple_bytes..(x + 1) * tuple_bytes;
                                place[tuple.clone()].copy_from_slice(&row[tuple]);
                            }
                        }
                    }
                }
            });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn extent(text: &str) -> Extent {
        Extent::parse("test", text).expect("six integers")
    }

    #[test]
    fn covers_are_exact() {
        let whole = extent("0 10 0 4 0 4");
        let halves = [extent("0 5 0 4 0 4"), extent("5 10 0 4 0 4")];
        assert!(check_cover(&whole, &halves).is_ok());
        assert!(check_cover(&whole, &[extent("-1 10 0 4 0 4")]).is_err());
        let gap = [extent("0 5 0 4 0 4"), extent("6 10 0 4 0 4")];
        let message = check_cover(&whole, &gap).unwrap_err().to_string();
        assert!(message.contains("5 6 0 4 0 4"), "{message}");
        let overlapping = [
            extent("0 6 0 3 0 4"),
            extent("4 10 0 3 0 4"),
            extent("0 10 2 4 0 4"),
        ];
        assert!(check_cover(&whole, &overlapping).is_ok());
    }

    #[test]
    fn rows_land_in_their_place() {
        let (whole, piece) = (extent("2 4 0 1 0 1"), extent("3 4 0 1 1 1"));
        let placement = Placement::new(&whole, &piece, Association::Point);
        let mut to = vec![0u8; 12];
        placement.scatter(&mut to, &[1, 2, 3, 4], 1, None);
        assert_eq!(to, [0, 0, 0, 0, 0, 0, 0, 1, 2, 0, 3, 4]);
        placement.scatter(&mut to, &[9, 9, 9, 7], 1, Some(&[1, 1, 1, 0]));
        assert_eq!(to[11], 7);
        assert_eq!(to[7], 1);
    }
}
