//! Reflection: what the compiled shaders say about the structs that both sides share.

use std::collections::BTreeMap;

use rspirv::binary::parse_words;
use rspirv::dr::{Instruction, Loader, Module, Operand};
use rspirv::spirv::{Decoration, Op};

use super::*;
use crate::mesh::{
    BEAM_QUADS, DeviceSubmesh, GROUP_PARTS, MeshHeader, STACK, ValueType, kinds, mesh_constant,
};
use crate::reference::{Held, MIXED};
use crate::shaders::ALL;

/// Offset and size of every member of a struct.
type Members = BTreeMap<String, (u32, u32)>;

macro_rules! members {
    ($name:ident { $($member:ident),* $(,)? }) => {{
        let value = $name::zeroed();
        let base = std::ptr::from_ref(&value) as usize;
        let all = Members::from([$((
            stringify!($member).to_owned(),
            (
                (std::ptr::from_ref(&value.$member) as usize - base) as u32,
                size_of_val(&value.$member) as u32,
            ),
        )),*]);
        // Every member is named here, or this does not compile.
        let $name { $($member: _),* } = value;
        all
    }};
}

fn load(spirv: &[u8]) -> Module {
    let mut loader = Loader::new();
    let words = words(spirv).expect("a compiled shader");
    parse_words(&words, &mut loader).expect("valid SPIR-V");
    loader.module()
}

fn id(operand: &Operand) -> u32 {
    operand.id_ref_any().expect("an id")
}

fn number(operand: &Operand) -> u32 {
    match operand {
        Operand::LiteralBit32(value) => *value,
        other => panic!("a number, not {other:?}"),
    }
}

fn definition(module: &Module, id: u32) -> &Instruction {
    let found = module
        .types_global_values
        .iter()
        .find(|i| i.result_id == Some(id));
    found.expect("the type is defined")
}

fn size_of_type(module: &Module, id_of_type: u32) -> u32 {
    let found = definition(module, id_of_type);
    match found.class.opcode {
        Op::TypeFloat | Op::TypeInt => number(&found.operands[0]) / 8,
        Op::TypeVector => number(&found.operands[1]) * size_of_type(module, id(&found.operands[0])),
        Op::TypePointer => 8,
        other => panic!("no such type is shared: {other:?}"),
    }
}

/// The members of a struct of this name, if the shader has one.
fn reflect(module: &Module, name: &str) -> Option<Members> {
    // A struct may be there twice: as it lies in memory, and as a plain value without offsets.
    let has_offsets = |struct_id: u32| {
        module.annotations.iter().any(|i| {
            i.class.opcode == Op::MemberDecorate
                && id(&i.operands[0]) == struct_id
                && matches!(i.operands[2], Operand::Decoration(Decoration::Offset))
        })
    };
    let named = module.debug_names.iter().find(|i| {
        i.class.opcode == Op::Name
            && matches!(&i.operands[1], Operand::LiteralString(s) if s == name)
            && module.types_global_values.iter().any(|t| {
                t.class.opcode == Op::TypeStruct && t.result_id == Some(id(&i.operands[0]))
            })
            && has_offsets(id(&i.operands[0]))
    })?;
    let struct_id = id(&named.operands[0]);
    let types = &definition(module, struct_id).operands;
    let mut members = Members::new();
    for (index, member) in types.iter().enumerate() {
        let of_member = |i: &&Instruction| {
            id(&i.operands[0]) == struct_id && number(&i.operands[1]) == index as u32
        };
        let name = module
            .debug_names
            .iter()
            .filter(|i| i.class.opcode == Op::MemberName)
            .find(of_member)
            .expect("members have names");
        let offset = module
            .annotations
            .iter()
            .filter(|i| i.class.opcode == Op::MemberDecorate)
            .filter(|i| matches!(i.operands[2], Operand::Decoration(Decoration::Offset)))
            .find(of_member)
            .expect("members have offsets");
        let Operand::LiteralString(name) = &name.operands[2] else {
            panic!("names are strings");
        };
        let size = size_of_type(module, id(member));
        members.insert(name.clone(), (number(&offset.operands[3]), size));
    }
    Some(members)
}

fn parameters() -> Members {
    members!(Parameters {
        rate,
        rate_x,
        rate_y,
        grid,
        anchor,
        anchor_x,
        anchor_y,
        direction,
        direction_x,
        direction_y,
        length_sq,
        box_lo,
        box_hi,
        texel,
        table_scale,
        metric_squares,
        metric_products,
        bins_per_unit,
        last_cell,
        cells,
        macrocells,
        axis_offset,
        picture,
        light,
        faces,
        corners,
        face_counts,
        bricks,
        nodes,
        num_face_groups,
        flange,
        num_shapes,
        tree_height,
    })
}

fn push() -> Members {
    members!(Push {
        table,
        next_active,
        ranges,
        skip,
        skip_before,
        counter,
        planes,
        blanked,
        clips,
        rgba,
        depth,
        samples,
        runs,
        offset,
        jitter,
        weight,
        frame,
        pass,
    })
}

fn submesh() -> Members {
    members!(DeviceSubmesh {
        lo,
        hi,
        base,
        sixteenths,
        nodes,
        positions,
        indices,
        values,
        cells_before,
        first_value,
        num_nodes,
        num_vertices,
        num_indices,
        kinds,
        first_node,
    })
}

fn mesh_header() -> Members {
    members!(MeshHeader {
        corner,
        slack,
        submeshes,
        minima,
        groups,
        links,
        sides,
        num_submeshes,
        minima_x,
        minima_y,
        minima_z,
        overflow,
        damage,
    })
}

#[test]
fn both_sides_agree_on_meshes() {
    let of_meshes = ALL.iter().filter(|(name, _)| name.starts_with("mesh_"));
    let mut seen = 0;
    for (name, spirv) in of_meshes {
        let module = load(spirv);
        assert_eq!(reflect(&module, "Submesh"), Some(submesh()), "{name}");
        assert_eq!(reflect(&module, "Mesh"), Some(mesh_header()), "{name}");
        seen += 1;
    }
    assert_eq!(seen, 8, "shaders over meshes");
    assert_eq!(size_of::<DeviceSubmesh>(), 128, "as an array has them");
    let text = concat!(
        include_str!("../mesh.glsl"),
        include_str!("../mesh_search.glsl")
    );
    let number = |name: &str| {
        let at = text.find(&format!("{name} = ")).expect("it is there");
        let rest = &text[at + name.len() + 3..];
        rest[..rest.find(';').expect("it ends")].to_owned()
    };
    let layout = [
        (
            "CHILD_DIVISIONS",
            vacua_pack::layout::CHILD_DIVISIONS as usize,
        ),
        ("NODE_WORDS", size_of::<vacua_pack::layout::MultiNode>() / 4),
        ("LEAF_WORDS", size_of::<vacua_pack::layout::MultiLeaf>() / 4),
        ("GROUP_PARTS", GROUP_PARTS),
        ("STACK", STACK as usize),
        ("BEAM_QUADS", BEAM_QUADS as usize),
        ("HAS_MARKER", kinds::MARKER as usize),
        ("HOLDS_OTHERS", kinds::OTHERS as usize),
        ("VALUE_F32", ValueType::F32 as usize),
        ("VALUE_U8", ValueType::U8 as usize),
        ("VALUE_I8", ValueType::I8 as usize),
        ("VALUE_U16", ValueType::U16 as usize),
        ("VALUE_I16", ValueType::I16 as usize),
        ("MIXED", MIXED as usize),
        ("HELD_PACKED", Held::Packed as usize),
        ("HELD_IN_BOXES", Held::InBoxes as usize),
        ("HELD_BY_FACES", Held::ByFaces as usize),
        ("HELD_BY_NEIGHBOURS", Held::ByNeighbours as usize),
        ("TETRAHEDRON", vacua_volume::CellType::Tetrahedron as usize),
        ("PYRAMID", vacua_volume::CellType::Pyramid as usize),
        ("WEDGE", vacua_volume::CellType::Wedge as usize),
        ("HEXAHEDRON", vacua_volume::CellType::Hexahedron as usize),
    ];
    for (name, ours) in layout {
        assert_eq!(number(name), ours.to_string(), "{name}");
    }
    let all = [
        text,
        include_str!("../mesh_march.comp"),
        include_str!("../mesh_launch.glsl"),
    ]
    .concat();
    let ids = [
        (mesh_constant::VALUE_TYPE, "VALUE_TYPE"),
        (mesh_constant::INNER_NODES, "INNER_NODES"),
        (mesh_constant::VARYING, "VARYING"),
        (mesh_constant::TOGETHER, "TOGETHER"),
        (mesh_constant::HAS_TETS, "HAS_TETS"),
        (mesh_constant::HAS_OTHERS, "HAS_OTHERS"),
        (mesh_constant::HELD, "HELD"),
        (mesh_constant::ONLY_KIND, "ONLY_KIND"),
        (mesh_constant::PLACES, "PLACES"),
        (mesh_constant::LANES, "LANES"),
        (mesh_constant::SUBGROUPS, "SUBGROUPS"),
    ];
    for (id, name) in ids {
        let mut lines = all.lines();
        let line = lines.find(|line| line.contains(&format!("constant_id = {id})")));
        let is_named = line.is_some_and(|line| line.contains(&format!(" {name} = ")));
        assert!(is_named, "{name}");
    }
    let invocations = format!("local_size_x_id = {}", mesh_constant::INVOCATIONS);
    assert!(all.contains(&invocations));
}

#[test]
fn both_sides_agree_on_every_member() {
    let mut seen = [0, 0];
    // Shaders that only say what a ray met share nothing but that.
    let without = [
        "trace.rmiss",
        "trace.rchit",
        "lowest.rmiss",
        "lowest.rahit",
        "face.rchit",
    ];
    for (name, spirv) in ALL {
        let module = load(spirv);
        let structs = [("Parameters", parameters()), ("Push", push())];
        for (i, (struct_name, ours)) in structs.into_iter().enumerate() {
            if let Some(theirs) = reflect(&module, struct_name) {
                assert_eq!(theirs, ours, "{struct_name} of {name}");
                seen[i] += 1;
            }
        }
    }
    assert!(
        seen.iter().all(|&n| n + 1 >= ALL.len() - without.len()),
        "{seen:?}"
    );
    assert!(size_of::<Push>() <= 128, "every device has as many bytes");
}

/// Negative control: a struct with two members swapped, and one that ends later, are noticed.
#[test]
fn disagreements_are_noticed() {
    let theirs = reflect(&load(ALL[0].1), "Push").expect("all shaders have it");
    let mut swapped = push();
    let (jitter, weight) = (swapped["jitter"], swapped["weight"]);
    swapped.insert("jitter".to_owned(), weight);
    swapped.insert("weight".to_owned(), jitter);
    assert_ne!(theirs, swapped);
    let mut wider = push();
    wider.insert("pass".to_owned(), (wider["pass"].0, 8));
    assert_ne!(theirs, wider);
}

/// The constants that both sides write.
#[test]
fn both_sides_agree_on_constants() {
    let text = include_str!("../shared.glsl");
    let value = |name: &str| {
        let at = text.find(&format!("{name} = ")).expect("it is there");
        let rest = &text[at + name.len() + 3..];
        rest[..rest.find(';').expect("it ends")].to_owned()
    };
    assert_eq!(value("MAX_SLABS"), MAX_SLABS.to_string());
    assert_eq!(
        value("TRANSFER_BINS"),
        vacua_volume::TRANSFER_BINS.to_string()
    );
    assert_eq!(value("BLOCK"), vacua_render::contract::BLOCK.to_string());
    assert_eq!(
        value("MAX_LEVEL"),
        vacua_render::contract::MAX_LEVEL.to_string()
    );
    assert_eq!(value("MAX_SAMPLES"), "1u << 23");
    assert_eq!(vacua_skip::MAX_SAMPLES, 1 << 23);
    assert_eq!(value("BELOW_ONE").parse(), Ok(1.0f32.next_down()));
    assert_eq!(value("LARGEST").parse(), Ok(f32::MAX));
    let doublings = vacua_render::contract::LIGHT.shininess.ilog2();
    assert_eq!(value("LIGHT_DOUBLINGS"), doublings.to_string());
    let boundary = include_str!("../boundary.glsl");
    assert!(boundary.contains("POINTS_EACH = 8;"));
    let [x, y, z] = BRICK;
    assert!(boundary.contains(&format!("BRICK = uvec3({x}, {y}, {z});")));
    assert!(boundary.contains(&format!("local_size_x = {GROUP})")));
    assert_eq!(x * y * z, 8 * GROUP);
    let tree = include_str!("../tree.glsl");
    assert!(tree.contains(&format!("WIDTH = {TREE_WIDTH};")));
    assert!(tree.contains(&format!("LOG_WIDTH = {};", TREE_WIDTH.ilog2())));
    assert!(tree.contains(&format!("return {NODE_WORDS} * (NODES_ABOVE")));
    let level = include_str!("../tree.comp");
    assert!(level.contains(&format!("local_size_x = {TREE_GROUP})")));
    let runs = include_str!("../runs.glsl");
    assert!(runs.contains(&format!("MAX_RUNS = {MAX_RUNS};")));
    assert!(runs.contains(&format!("RUN_STRIDE = {};", TILE * TILE)));
    let all = [text, include_str!("../subgroup.glsl")].concat();
    for (id, name) in [
        (constant::SKIPPING, "SKIPPING"),
        (constant::CELL_DATA, "CELL_DATA"),
        (constant::CHECK_FINITE, "CHECK_FINITE"),
        (constant::LOG_SCALE, "LOG_SCALE"),
        (constant::SHADED, "SHADED"),
        (constant::MAXIMUM, "MAXIMUM"),
        (constant::BLANKED, "BLANKED"),
        (constant::RECTILINEAR, "RECTILINEAR"),
        (constant::NUM_SLABS, "NUM_SLABS"),
        (constant::LANES, "LANES"),
        (constant::SUBGROUPS, "SUBGROUPS"),
    ] {
        let line = all
            .lines()
            .find(|line| line.contains(&format!("constant_id = {id})")));
        assert!(
            line.is_some_and(|line| line.contains(&format!(" {name} = "))),
            "{name}"
        );
    }
    let invocations = format!("local_size_x_id = {}", constant::INVOCATIONS);
    assert!(all.contains(&invocations));
}
