//! The compiled shaders. Sources lie beside their callers; `cargo xtask shaders` compiles them.

/// Names all shaders.
macro_rules! shaders {
    ($($(#[$doc:meta])* $name:ident = $file:literal;)*) => {
        $($(#[$doc])* pub(crate) const $name: &[u8] = include_bytes!(concat!($file, ".spv"));)*

        /// All of them, by name.
        pub(crate) const ALL: &[(&str, &[u8])] = &[$(($file, $name)),*];
    };
}

shaders! {
    /// Ranges of macrocells.
    RANGES = "ranges";
    /// Which macrocells are active.
    CLASSIFY = "classify";
    /// A pass of the distance map.
    DISTANCE = "distance";
    /// Faces of the boundary in each group of lattice points.
    BOUNDARY_COUNT = "boundary_count";
    /// Faces before each group, and of all.
    BOUNDARY_SCAN = "boundary_scan";
    /// The boundary's faces and triangles.
    BOUNDARY_WRITE = "boundary_write";
    /// A level of our own hierarchy over the boundary's faces.
    TREE = "tree";
    /// The picture, by `none` and `grid`, each ray for itself.
    MARCH = "march";
    /// The picture of a uniform grid, by `none` and `grid`, subgroups looking ahead together.
    MARCH_BEAMS = "march_beams";
    /// The same where surfaces are lit.
    MARCH_BEAMS_LIT = "march_beams_lit";
    /// The picture of a uniform grid over runs that were found, subgroups marching together.
    MARCH_BEAMS_RUNS = "march_beams_runs";
    /// The same where surfaces are lit.
    MARCH_BEAMS_RUNS_LIT = "march_beams_runs_lit";
    /// The picture, over runs that were found.
    MARCH_RUNS = "march_runs";
    /// Where rays meet what is active, by `mesh` through ray queries.
    QUERY = "query";
    /// Where rays meet what is active, by `mesh` over our own hierarchy.
    PACKETS = "packets";
    /// The boundary of what is active, over the picture.
    OVERLAY = "overlay";
    /// Where rays meet what is active, by `mesh` on a ray tracing pipeline.
    MESH_GENERATION = "mesh.rgen";
    /// The same by `boxes`.
    BOXES_GENERATION = "boxes.rgen";
    /// Where a ray enters a box.
    BOXES_INTERSECTION = "boxes.rint";
    /// What a ray meets first.
    TRACE_HIT = "trace.rchit";
    /// A ray meets nothing.
    TRACE_MISS = "trace.rmiss";
    /// Whether a packed mesh is sound.
    PACKED_CHECK = "mesh_check";
    /// The picture of a packed mesh.
    PACKED_MARCH = "mesh_march";
    /// Values of a packed mesh at places.
    PACKED_SAMPLE = "mesh_sample";
    /// Boxes of the multi-leaves, or the cells, of a mesh.
    PACKED_BOXES = "mesh_boxes";
    /// The picture of a packed mesh, whose multi-leaves ray queries find.
    PACKED_QUERY = "mesh_query";
    /// The picture of a packed mesh, whose multi-leaves a ray tracing pipeline finds.
    PACKED_GENERATION = "mesh_traced.rgen";
    /// Which cell of a multi-leaf a place is in.
    PACKED_INTERSECTION = "mesh_traced.rint";
    /// The picture of tetrahedra that know their faces or neighbours.
    FACES_GENERATION = "mesh_faces.rgen";
    /// The face that a ray meets first.
    FACE_HIT = "face.rchit";
    /// The first of all cells that a place is in.
    LOWEST_HIT = "lowest.rahit";
    /// All cells have been met.
    LOWEST_MISS = "lowest.rmiss";
}
