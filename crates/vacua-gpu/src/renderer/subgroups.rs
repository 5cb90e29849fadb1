//! How the subgroups of a device search a mesh: how many there are to a workgroup, and the shared memory
//! that they take.

use vacua_render::contract::BLOCK;

use super::Search;
use crate::mesh::{BEAM_QUADS, STACK, mesh_constant};
use crate::vulkan::{Constant, DeviceInfo, DeviceKind};

/// Subgroups of 32 lanes in a workgroup that is to keep down what registers each gets.
const MANY: u32 = 12;

/// Bytes of a word of shared memory.
const WORD_BYTES: u32 = 4;

/// Cells of which it must be known in which sub-mesh they are, once they are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Parts {
    OfTetrahedra,
    OfAll,
}

/// What there is to be kept in shared memory while subgroups search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kept {
    /// Whether there are tetrahedra, and other cells.
    pub tets: bool,
    pub others: bool,
    /// Whether values are those of cells.
    pub cell_data: bool,
    /// Whether it must be known in which sub-mesh cells other than tetrahedra are.
    pub parts: bool,
}

impl Kept {
    /// Bytes of shared memory of a workgroup; a test compares it with what the shader declares.
    fn shared_bytes(self, lanes: u32, subgroups: u32) -> u32 {
        let a_lane = [
            (self.tets, 4),
            (self.tets && self.cell_data, 2),
            (self.others, 4),
            (self.others && self.cell_data, 4),
            (true, 2),
            (self.tets, 2),
            (self.tets && self.cell_data, 2),
            (true, BLOCK as u32),
            (self.tets || self.parts, BLOCK as u32),
            (self.tets && self.cell_data, BLOCK as u32),
            (self.others, BLOCK as u32),
        ];
        // What is not there takes a word for each array, of which those of leaves are counted as one.
        let absent = |&&(is_kept, _): &&(bool, u32)| !is_kept;
        let absent = a_lane.iter().filter(absent).count() as u32 + u32::from(!self.tets);
        let a_lane = a_lane.iter().filter(|(is_kept, _)| *is_kept);
        let a_lane: u32 = a_lane.map(|(_, words)| words).sum();
        let a_subgroup = STACK + 4 * BEAM_QUADS + a_lane * lanes;
        WORD_BYTES * (a_subgroup * subgroups + absent)
    }
}

/// How a device's subgroups search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Subgroups {
    /// Lanes of one.
    lanes: u32,
    /// Of a workgroup.
    count: u32,
    /// How their lanes search; together takes eight of them.
    search: Search,
}

impl Subgroups {
    /// Least lanes that search together: the children of a node.
    const LEAST: u32 = 8;

    pub(super) fn new(info: &DeviceInfo, lanes: u32, search: Search, kept: Kept) -> Self {
        // Mesa's lavapipe has all subgroups of a workgroup wait where one does. Elsewhere the shared memory
        // that every device should have is enough for four that look for tetrahedra. Where maps are
        // inverted, an H100's driver gives each lane 255 registers, and so runs 8 subgroups at a time;
        // workgroups of 12 have it make do with 168, 7 % faster.
        let has_room = info.max_shared_bytes >= kept.shared_bytes(lanes, MANY)
            && info.max_invocations >= MANY * lanes;
        let count = match (info.kind, lanes) {
            (DeviceKind::Cpu, _) => 1,
            (_, 32) if kept.others && has_room => MANY,
            (_, 0..=32) if !kept.others => 4,
            (_, 0..=8) => 4,
            _ => 1,
        };
        let search = if lanes < Self::LEAST {
            Search::Alone
        } else {
            search
        };
        Self {
            lanes,
            count,
            search,
        }
    }

    pub(super) fn constants(self) -> [Constant; 4] {
        use mesh_constant::*;
        let constant = |id, bits| Constant { id, bits };
        [
            constant(TOGETHER, u32::from(self.search == Search::Together)),
            constant(LANES, self.lanes),
            constant(SUBGROUPS, self.count),
            constant(INVOCATIONS, self.invocations()),
        ]
    }

    /// Lanes of one.
    pub(super) fn lanes(self) -> u32 {
        self.lanes
    }

    /// Invocations of a workgroup.
    pub(super) fn invocations(self) -> u32 {
        self.lanes * self.count
    }

    /// Workgroups of the march: tiles about as wide as high, one below the other.
    pub(super) fn tiles(self, width: u32, height: u32) -> [u32; 3] {
        let columns = 1 << self.lanes.ilog2().div_ceil(2);
        let rows = self.lanes / columns * self.count;
        [width.div_ceil(columns), height.div_ceil(rows), 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words of an array as the shader declares it: `shared TYPE NAME[CONDITION ? LENGTH : 1];`.
    fn declared_words(line: &str, kept: Kept, lanes: u32, subgroups: u32) -> u32 {
        let (declared, length) = line.split_once('[').expect("an array");
        let length = length.split_once(']').expect("its end").0;
        let (condition, length) = match length.split_once(" ? ") {
            Some((condition, rest)) => (condition, rest.split_once(" : ").expect("both").0),
            None => ("", length),
        };
        let holds = |name: &str| match name {
            "" => true,
            "HAS_TETS" => kept.tets,
            "HAS_OTHERS" => kept.others,
            "CELL_DATA" => kept.cell_data,
            // As the march defines it.
            "NEEDS_PARTS" => kept.tets || kept.parts,
            _ => panic!("what is `{name}`?"),
        };
        let number = |name: &str| match name {
            "SUBGROUPS" => subgroups,
            "LANES" => lanes,
            "LEAVES" => 2 * lanes,
            "STACK" => STACK,
            "BEAM_QUADS" => BEAM_QUADS,
            "BLOCK" => BLOCK as u32,
            _ => name.parse().expect("a number"),
        };
        let a_length = if declared.contains(" vec4 ") { 4 } else { 1 };
        match condition.split(" && ").all(holds) {
            true => a_length * length.split(" * ").map(number).product::<u32>(),
            false => 1,
        }
    }

    #[test]
    fn shared_memory_is_what_the_shader_declares() {
        let text = include_str!("../mesh_search.glsl");
        assert!(text.contains("const uint LEAVES = 2 * LANES;"));
        let march = include_str!("../mesh_march.comp");
        assert!(march.contains("const bool NEEDS_PARTS = HAS_TETS || SHADED;"));
        let arrays = || text.lines().filter(|line| line.starts_with("shared "));
        assert_eq!(arrays().count(), 14);
        for bits in 0..16 {
            let is = |bit: u32| bits >> bit & 1 == 1;
            let kept = Kept {
                tets: is(0),
                others: is(1),
                cell_data: is(2),
                parts: is(3),
            };
            for (lanes, subgroups) in [(8, 1), (32, 4), (32, MANY), (64, 1)] {
                let words: u32 = arrays()
                    .map(|line| declared_words(line, kept, lanes, subgroups))
                    .sum();
                assert_eq!(
                    kept.shared_bytes(lanes, subgroups),
                    WORD_BYTES * words,
                    "{kept:?}, {subgroups} subgroups of {lanes}"
                );
            }
        }
    }
}
