//! Pairs of tetrahedra that share a face, found among the tetrahedra of one leaf.
//!
//! Source: paper B, §4.1 (five indices for two tetrahedra).
//!
//! A pair `a b c d e` stands for the tetrahedra `a b c d` and `a c b e`. Both come back with the
//! orientation they had, so that only tetrahedra which see their common face from its two sides
//! pair; inverted and flat ones are never offered.

/// A tetrahedron's face opposite each of its points, ordered so that the face followed by the point
/// is an even permutation of the tetrahedron.
const OPPOSITE_FACE: [[usize; 3]; 4] = [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]];

/// The most tetrahedra that [`match_pairs`] looks at together.
pub const MAX_CANDIDATES: usize = 64;

/// The pair that two tetrahedra form, if they do. Neither may repeat a point.
#[inline(always)]
pub fn pair_of(first: [u32; 4], second: [u32; 4]) -> Option<[u32; 5]> {
    let mut shared = [0; 4];
    for v in second {
        for k in 0..4 {
            shared[k] |= u32::from(first[k] == v);
        }
    }
    if shared[0] + shared[1] + shared[2] + shared[3] != 3 {
        return None;
    }
    let apex = shared.iter().position(|&s| s == 0)?;
    let other = (0..4).find(|&k| !first.contains(&second[k]))?;
    let [a, b, c] = OPPOSITE_FACE[apex].map(|k| first[k]);
    let seen = OPPOSITE_FACE[other].map(|k| second[k]);
    let turned = [[a, c, b], [c, b, a], [b, a, c]];
    turned
        .contains(&seen)
        .then_some([a, b, c, first[apex], second[other]])
}

/// The two tetrahedra of a pair.
#[inline(always)]
pub fn tets_of([a, b, c, d, e]: [u32; 5]) -> [[u32; 4]; 2] {
    [[a, b, c, d], [a, c, b, e]]
}

/// Joins as many tetrahedra as it finds partners for: first those with the fewest candidates.
///
/// `tets` are at most [`MAX_CANDIDATES`] (others past that stay single); `pairable` says which may
/// pair at all. Calls `pair` with the two places in `tets` and the five indices, and returns which
/// tetrahedra stayed single, a bit each.
pub fn match_pairs(
    tets: &[[u32; 4]],
    pairable: &[bool],
    mut pair: impl FnMut(usize, usize, [u32; 5]),
) -> u64 {
    let n = tets.len().min(MAX_CANDIDATES);
    let mut neighbours = [0u64; MAX_CANDIDATES];
    // How many of its neighbours are still free.
    let mut degree = [0u32; MAX_CANDIDATES];
    for i in 0..n {
        if !pairable[i] {
            continue;
        }
        for j in i + 1..n {
            if pairable[j] && pair_of(tets[i], tets[j]).is_some() {
                neighbours[i] |= 1 << j;
                neighbours[j] |= 1 << i;
                degree[i] += 1;
                degree[j] += 1;
            }
        }
    }
    let mut free: u64 = if n == 64 { u64::MAX } else { (1 << n) - 1 };
    let fewest = |set: u64, degree: &[u32; MAX_CANDIDATES]| {
        bits(set)
            .filter(|&i| degree[i] > 0)
            .min_by_key(|&i| (degree[i], i))
    };
    while let Some(i) = fewest(free, &degree)
        && let Some(j) = fewest(neighbours[i] & free, &degree)
    {
        let (i, j) = (i.min(j), i.max(j));
        free &= !(1 << i | 1 << j);
        bits(neighbours[i]).for_each(|k| degree[k] -= 1);
        bits(neighbours[j]).for_each(|k| degree[k] -= 1);
        if let Some(five) = pair_of(tets[i], tets[j]) {
            pair(i, j, five);
        }
    }
    free
}

/// Places of the bits that are set, lowest first.
#[inline(always)]
pub fn bits(mut set: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (set != 0).then(|| {
            let i = set.trailing_zeros() as usize;
            set &= set - 1;
            i
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The same points in the same orientation, smallest first.
    fn canonical(tet: [u32; 4]) -> [u32; 4] {
        let mut t = tet;
        let mut odd = false;
        for i in 0..4 {
            for j in 0..3 - i {
                if t[j] > t[j + 1] {
                    t.swap(j, j + 1);
                    odd = !odd;
                }
            }
        }
        if odd {
            t.swap(2, 3);
        }
        t
    }

    #[test]
    fn two_sides_of_a_face_pair_and_come_back() {
        // 0 1 2 3, and 4 on the other side of every face in turn.
        let first = [0, 1, 2, 3];
        for k in 0..4 {
            let f = OPPOSITE_FACE[k];
            let second = [f[0], f[2], f[1], 4].map(|v| v as u32);
            let pair = pair_of(first, second).expect("they share a face");
            let back = tets_of(pair);
            assert_eq!(canonical(back[0]), canonical(first));
            assert_eq!(canonical(back[1]), canonical(second));
            let same_side = [second[1], second[0], second[2], 4];
            assert_eq!(
                pair_of(first, same_side),
                None,
                "overlapping tets do not pair"
            );
        }
        assert_eq!(pair_of(first, [1, 0, 2, 3]), None, "the same four points");
        assert_eq!(pair_of(first, [0, 1, 4, 5]), None, "an edge is no face");
    }

    #[test]
    fn a_ring_of_six_pairs_completely_and_unpairable_ones_stay_single() {
        let kuhn: [[u32; 4]; 6] = [
            [0, 1, 2, 6],
            [0, 2, 3, 6],
            [0, 3, 7, 6],
            [0, 7, 4, 6],
            [0, 4, 5, 6],
            [0, 5, 1, 6],
        ];
        let mut pairs = 0;
        assert_eq!(match_pairs(&kuhn, &[true; 6], |_, _, _| pairs += 1), 0);
        assert_eq!(pairs, 3);
        assert_eq!(match_pairs(&kuhn, &[false; 6], |_, _, _| {}), 0b11_1111);
        assert_eq!(match_pairs(&[], &[], |_, _, _| {}), 0);
    }

    proptest! {
        #[test]
        fn every_tet_comes_back_once(
            tets in prop::collection::vec(
                prop::sample::subsequence((0u32..7).collect::<Vec<_>>(), 4).prop_shuffle(), 0..40),
            allowed in prop::collection::vec(any::<bool>(), 40),
        ) {
            let tets: Vec<[u32; 4]> = tets.iter().map(|t| [t[0], t[1], t[2], t[3]]).collect();
            let mut back = Vec::new();
            let mut used = 0u64;
            let single = match_pairs(&tets, &allowed, |i, j, five| {
                assert!(allowed[i] && allowed[j]);
                assert_eq!(used & (1 << i | 1 << j), 0);
                used |= 1 << i | 1 << j;
                back.extend(tets_of(five).map(canonical));
            });
            back.extend(bits(single).map(|i| canonical(tets[i])));
            let mut expected: Vec<_> = tets.iter().map(|&t| canonical(t)).collect();
            back.sort_unstable();
            expected.sort_unstable();
            prop_assert_eq!(back, expected);
        }
    }
}
