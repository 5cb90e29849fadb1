//! Parts of a mesh, as Tables 4 and 6 have them: the cells of its first sub-meshes.

use vacua_pack::reference::Cells;
use vacua_pack::{EncodeOptions as PackOptions, encode};
use vacua_volume::{DataArray, Dataset, UnstructuredMesh};

use super::measure::{self, Stage};
use super::peers::{Kind, Peer};
use super::{SampleOptions, Share, SharePeer, ShareResult};
use crate::cell::Cell;
use crate::error::BenchError;
use crate::meshes::{self, Packed, Scene};

/// Sub-meshes to a share, at least, so that shares are about equal.
const SUBMESHES_PER_SHARE: usize = 4;
/// Bits of an index with which a mesh is cut into shares, most first.
const CUTTING_BITS: [u32; 4] = [16, 13, 10, 8];

/// All shares, of the first mesh.
pub(super) fn all(options: &SampleOptions) -> Vec<ShareResult> {
    let Some(&Scene(kind)) = options.models.first() else {
        return Vec::new();
    };
    if options.shares.is_empty() {
        return Vec::new();
    }
    let made = options.size.make(kind).map_err(|e| e.to_string());
    let each = options.shares.iter();
    each.map(|&share| {
        tracing::info!(part = share.part, of = share.of, "measuring a share");
        let measured = match &made {
            Ok(dataset) => {
                measured(dataset, options.size.of(kind), share, options).map_err(|e| e.to_string())
            }
            Err(why) => Err(why.clone()),
        };
        measured.unwrap_or_else(|why| ShareResult {
            share,
            cells: Cell::empty(why),
            peers: Vec::new(),
        })
    })
    .collect()
}

/// The cells of the first sub-meshes.
pub(crate) fn cut(mesh: &UnstructuredMesh, share: Share) -> Result<UnstructuredMesh, BenchError> {
    if share.part == share.of {
        return Ok(mesh.clone());
    }
    let mut encoded = None;
    for index_bits in CUTTING_BITS {
        let pack_options = PackOptions {
            index_bits,
            ..PackOptions::default()
        };
        let with_bits = encode(mesh, pack_options)?;
        let is_enough = with_bits.mesh.submeshes().len() >= SUBMESHES_PER_SHARE * share.of;
        encoded = Some(with_bits);
        if is_enough {
            break;
        }
    }
    let Some(encoded) = encoded else {
        unreachable!("there are bits to cut with");
    };
    let submeshes = encoded.mesh.submeshes();
    // Of a mesh that is too small to be cut so finely one sub-mesh is taken.
    let taken = (submeshes.len() * share.part / share.of).max(1);
    let end = submeshes.get(taken).map(|s| s.first_cell as usize);
    let end = end.unwrap_or(encoded.map.cells.len());
    let (mut types, mut connectivity) = (Vec::with_capacity(end), Vec::new());
    for place in 0..end {
        let cell = mesh.cell(encoded.map.cells.get(place) as usize);
        types.push(cell.cell_type);
        connectivity.extend(cell.points().iter().map(|&p| p as u32));
    }
    let connectivity = DataArray::from_vec(connectivity, 1)?;
    Ok(UnstructuredMesh::mixed(
        mesh.positions().clone(),
        types,
        connectivity,
    )?)
}

fn measured(
    dataset: &Dataset,
    size: usize,
    share: Share,
    options: &SampleOptions,
) -> Result<ShareResult, BenchError> {
    let mesh = cut(meshes::mesh(dataset)?, share)?;
    let volume = meshes::volume(dataset)?;
    let packed = Packed::new(&mesh, volume.scalars(), PackOptions::default())?;
    drop((mesh, volume));
    let stage = Stage::new(&packed, size)?;
    let rays = stage.rays(&packed, options.pixels)?;
    let packed_bytes = packed.num_bytes();
    let references: Vec<_> = {
        let cells = Cells::new(&packed.encoded.mesh, &packed.encoded.map, &packed.field)?;
        let build = |kind: Kind| (kind, measure::build(kind, &cells));
        Kind::TABLE_6.into_iter().map(build).collect()
    };
    let mut peers = vec![Peer::packed(&packed.encoded.mesh, &packed.field)];
    let built = references
        .iter()
        .filter_map(|(_, built)| built.as_ref().ok());
    peers.extend(built.map(|(reference, _)| Peer::Reference(&**reference)));
    let all: Vec<&Peer> = peers.iter().collect();
    let pictures = measure::pictures(&all, &rays, &stage.table, options.repeats);
    let mut took = pictures.into_iter().map(|(_, took)| took);
    let mut next = |name: &str, bytes: usize| {
        let took = took.next();
        SharePeer {
            name: name.to_owned(),
            bytes: Cell::Value(bytes as u64),
            ratio: Cell::Value(bytes as f64 / packed_bytes as f64),
            secs: took.map_or(Cell::empty("not rendered"), |t| Cell::Value(t.secs)),
            core_secs: took.map_or(Cell::empty("not rendered"), |t| measure::core_secs(&t)),
        }
    };
    let mut results = vec![next("packed", packed_bytes)];
    for (kind, built) in &references {
        results.push(match built {
            Ok((reference, _)) => next(kind.name(), reference.num_bytes()),
            Err(why) => SharePeer {
                name: kind.name().to_owned(),
                bytes: Cell::empty(why),
                ratio: Cell::empty(why),
                secs: Cell::empty(why),
                core_secs: Cell::empty(why),
            },
        });
    }
    Ok(ShareResult {
        share,
        cells: Cell::Value(packed.encoded.mesh.num_cells()),
        peers: results,
    })
}
