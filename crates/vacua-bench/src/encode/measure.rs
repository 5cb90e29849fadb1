//! Encodes one mesh in every way.

use vacua_pack::reference::{Cells, LinkedBvh, MinMaxBvh, Reference};
use vacua_pack::{EncodeOptions as PackOptions, Variant};
use vacua_synth::MeshKind;
use vacua_volume::Dataset;

use super::{BitsResult, EncodeOptions, LayoutResult, ModelResult, PackedParts, VariantResult};
use crate::cell::Cell;
use crate::error::BenchError;
use crate::machine::available_bytes;
use crate::meshes::{self, Packed, Scene, VARIANTS};
use crate::paper_b;
use crate::timing::{Took, clocked, medians};

/// Bytes a cell that building an uncompressed layout takes at most, about.
pub(crate) const BUILD_BYTES_PER_CELL: u64 = 900;

/// Refuses what does not fit memory.
pub(crate) fn check_memory(name: &str, needed_bytes: u64) -> Result<(), BenchError> {
    let available_bytes = available_bytes();
    if available_bytes > 0 && needed_bytes > available_bytes {
        return Err(BenchError::Memory {
            name: name.to_owned(),
            needed_bytes,
            available_bytes,
            scale: 1.0,
        });
    }
    Ok(())
}

/// Everything about one mesh.
pub(super) fn model(model: Scene, options: &EncodeOptions) -> ModelResult {
    let Scene(kind) = model;
    tracing::info!(%kind, "encoding a mesh");
    let made = options.size.make(kind);
    let mut result = ModelResult {
        model,
        size: options.size.of(kind),
        paper_model: paper_b::model(kind).name.to_owned(),
        points: Cell::empty("not made"),
        cells: [0; 4],
        variants: Vec::new(),
        layouts: Vec::new(),
    };
    let dataset = match made {
        Ok(dataset) => dataset,
        Err(e) => {
            let why = e.to_string();
            result.points = Cell::empty(&why);
            let variants = VARIANTS.map(|(_, name)| empty_variant(kind, name, &why));
            result.variants = variants.into();
            result.layouts = layouts(kind, Err(&why), options);
            return result;
        }
    };
    if let Some(mesh) = dataset.mesh() {
        result.points = Cell::Value(mesh.num_points() as u64);
        result.cells = mesh.num_cells_by_type().map(|n| n as u64);
    }
    // What the layouts are built from is that of the last.
    let mut last: Option<Result<Packed, String>> = None;
    for (which, name) in VARIANTS {
        drop(last.take());
        result
            .variants
            .push(match variant(kind, &dataset, (which, name), options) {
                Ok((measured, packed)) => {
                    last = Some(Ok(packed));
                    measured
                }
                Err(e) => {
                    last = Some(Err(e.to_string()));
                    empty_variant(kind, name, &e.to_string())
                }
            });
    }
    drop(dataset);
    let last = last.unwrap_or_else(|| Err("not encoded".to_owned()));
    result.layouts = layouts(kind, last.as_ref().map_err(String::as_str), options);
    result
}

/// Encodes once.
fn encode_once(dataset: &Dataset, options: PackOptions) -> Result<(Packed, Took), BenchError> {
    let mesh = meshes::mesh(dataset)?;
    let volume = meshes::volume(dataset)?;
    let (packed, took) = clocked(|| Packed::new(mesh, volume.scalars(), options));
    Ok((packed?, took))
}

fn variant(
    kind: MeshKind,
    dataset: &Dataset,
    (variant, name): (Variant, &str),
    options: &EncodeOptions,
) -> Result<(VariantResult, Packed), BenchError> {
    let pack_options = PackOptions {
        variant,
        ..PackOptions::default()
    };
    let (mut packed, first) = encode_once(dataset, pack_options)?;
    let mut all = vec![first];
    for _ in 1..options.repeats {
        drop(packed);
        let took;
        (packed, took) = encode_once(dataset, pack_options)?;
        all.push(took);
    }
    let Took { secs, core_secs } = medians(&all);
    let mesh = &packed.encoded.mesh;
    let (bytes, field) = (mesh.bytes(), packed.field.bytes());
    let map = &packed.encoded.map;
    let parts = PackedParts {
        positions: bytes.positions as u64,
        values: field.values as u64,
        indices: bytes.indices as u64,
        nodes: bytes.nodes as u64,
        outer: bytes.outer as u64,
        headers: bytes.submeshes as u64,
        ranges: (field.ranges + field.cells_before) as u64,
        map: (map.points.num_bytes() + map.cells.num_bytes()) as u64,
    };
    let cells = mesh.num_cells() as f64;
    let result = VariantResult {
        variant: name.to_owned(),
        vertices: Cell::Value(mesh.num_vertices() as u64),
        submeshes: Cell::Value(mesh.submeshes().len() as u64),
        nodes: Cell::Value(mesh.nodes().len() as u64),
        bytes_per_cell: Cell::Value(parts.total() as f64 / cells),
        parts: Some(parts),
        secs: Cell::Value(secs),
        cells_per_sec: Cell::Value(cells / secs),
        cells_per_core_sec: core_secs.map_or(
            Cell::empty("this system has no clock of a process's own"),
            |secs| Cell::Value(cells / secs),
        ),
        target_bytes_per_cell: paper_b::target(kind, name),
        paper_bytes_per_cell: paper_bytes(kind, name),
    };
    Ok((result, packed))
}

fn paper_bytes(kind: MeshKind, name: &str) -> Option<f64> {
    let model = paper_b::model(kind);
    Some(model.variant_bytes(name)? / model.cells)
}

fn empty_variant(kind: MeshKind, name: &str, why: &str) -> VariantResult {
    VariantResult {
        variant: name.to_owned(),
        vertices: Cell::empty(why),
        submeshes: Cell::empty(why),
        nodes: Cell::empty(why),
        parts: None,
        bytes_per_cell: Cell::empty(why),
        secs: Cell::empty(why),
        cells_per_sec: Cell::empty(why),
        cells_per_core_sec: Cell::empty(why),
        target_bytes_per_cell: paper_b::target(kind, name),
        paper_bytes_per_cell: paper_bytes(kind, name),
    }
}

/// Builds OSPRay's layouts of the same cells, one after the other.
fn layouts(
    kind: MeshKind,
    packed: Result<&Packed, &str>,
    options: &EncodeOptions,
) -> Vec<LayoutResult> {
    let cells = || -> Result<(Cells, f64), String> {
        let packed = packed.map_err(str::to_owned)?;
        if options.quick {
            return Err("a quick run leaves out OSPRay's layouts".to_owned());
        }
        let encoded = &packed.encoded;
        let num_cells = encoded.mesh.num_cells();
        check_memory(kind.name(), num_cells.saturating_mul(BUILD_BYTES_PER_CELL))
            .map_err(|e| e.to_string())?;
        let cells = Cells::new(&encoded.mesh, &encoded.map, &packed.field);
        Ok((cells.map_err(|e| e.to_string())?, packed.num_bytes() as f64))
    };
    let cells = cells();
    let model = paper_b::model(kind);
    let measure = |name: &str, paper: Option<f64>, build: &dyn Fn(&Cells) -> Box<dyn Reference>| {
        let mut result = LayoutResult {
            name: name.to_owned(),
            parts: Vec::new(),
            bytes: Cell::empty("not built"),
            bytes_per_cell: Cell::empty("not built"),
            ratio: Cell::empty("not built"),
            paper_bytes_per_cell: paper.map(|bytes| bytes / model.cells),
            paper_ratio: paper.map(|bytes| bytes / model.variant_2_bytes),
        };
        match &cells {
            Ok((cells, packed_bytes)) => {
                tracing::info!(name, "building a layout");
                let layout = build(cells);
                let parts = layout.parts().into_iter();
                result.parts = parts.map(|(part, n)| (part.to_owned(), n as u64)).collect();
                let bytes = layout.num_bytes();
                result.bytes = Cell::Value(bytes as u64);
                result.bytes_per_cell = Cell::Value(bytes as f64 / layout.num_cells() as f64);
                result.ratio = Cell::Value(bytes as f64 / packed_bytes);
            }
            Err(why) => {
                result.bytes = Cell::empty(why);
                result.bytes_per_cell = Cell::empty(why);
                result.ratio = Cell::empty(why);
            }
        }
        result
    };
    vec![
        measure("OSPRay 1.8.5", model.ospray_1_bytes, &|cells| {
            Box::new(MinMaxBvh::new(cells))
        }),
        measure("OSPRay 2.x (Open VKL)", model.ospray_2_bytes, &|cells| {
            Box::new(LinkedBvh::new(cells))
        }),
    ]
}

/// Table 2, on the first mesh.
pub(super) fn index_bits(options: &EncodeOptions) -> Vec<BitsResult> {
    let Some(&Scene(kind)) = options.models.first() else {
        return Vec::new();
    };
    let made = options.size.make(kind).map_err(|e| e.to_string());
    let each = options.index_bits.iter();
    each.map(|&bits| {
        tracing::info!(%kind, bits, "encoding with other indices");
        let measured = made.as_ref().map_err(String::clone).and_then(|dataset| {
            let pack_options = PackOptions {
                index_bits: bits,
                ..PackOptions::default()
            };
            encode_once(dataset, pack_options)
                .map(|encoded| (encoded, dataset.mesh().map_or(0, |m| m.num_points())))
                .map_err(|e| e.to_string())
        });
        match measured {
            Ok(((packed, took), points)) => of_bits(bits, &packed, took.secs, points),
            Err(why) => BitsResult {
                bits,
                groups: Cell::empty(&why),
                cells_per_group: Cell::empty(&why),
                vertices_per_group: Cell::empty(&why),
                vertices: Cell::empty(&why),
                replication: Cell::empty(&why),
                bytes_per_cell: Cell::empty(&why),
                total_bytes_per_cell: Cell::empty(&why),
                secs: Cell::empty(&why),
            },
        }
    })
    .collect()
}

fn of_bits(bits: u32, packed: &Packed, secs: f64, points: usize) -> BitsResult {
    let mesh = &packed.encoded.mesh;
    let (cells, groups) = (mesh.num_cells() as f64, mesh.submeshes().len() as f64);
    let vertices = mesh.num_vertices() as f64;
    let bytes = mesh.bytes();
    let data = bytes.positions + bytes.indices + packed.field.bytes().values;
    BitsResult {
        bits,
        groups: Cell::Value(mesh.submeshes().len() as u64),
        cells_per_group: Cell::Value(cells / groups),
        vertices_per_group: Cell::Value(vertices / groups),
        vertices: Cell::Value(mesh.num_vertices() as u64),
        replication: Cell::Value(vertices / points as f64),
        bytes_per_cell: Cell::Value(data as f64 / cells),
        total_bytes_per_cell: Cell::Value(packed.num_bytes() as f64 / cells),
        secs: Cell::Value(secs),
    }
}
