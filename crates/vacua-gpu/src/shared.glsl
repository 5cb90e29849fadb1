// What the host tells all shaders; `shared.rs` is the other side, and a test compares the two.

#extension GL_EXT_buffer_reference : require
#extension GL_EXT_nonuniform_qualifier : require

// Images that a volume is split into, at most.
const int MAX_SLABS = 16;
// Linear pieces of the transfer table; it has one entry more.
const int TRANSFER_BINS = 1024;
// Samples in a block.
const uint BLOCK = 8;
// Highest level of dyadic blocks, and samples that a block of it spans.
const uint MAX_LEVEL = 6;
const uint ALIGNMENT = BLOCK << MAX_LEVEL;
// Samples that a ray may have, at most.
const uint MAX_SAMPLES = 1u << 23;
// The largest number below 1.
const float BELOW_ONE = 0.99999994;
const float LARGEST = 3.40282347e38;
// Times that a highlight's cosine is squared.
const int LIGHT_DOUBLINGS = 5;

// What a pipeline is specialised for.
layout(constant_id = 0) const bool SKIPPING = true;
layout(constant_id = 1) const bool CELL_DATA = false;
layout(constant_id = 2) const bool CHECK_FINITE = false;
layout(constant_id = 3) const bool LOG_SCALE = false;
layout(constant_id = 4) const bool SHADED = false;
layout(constant_id = 5) const bool MAXIMUM = false;
layout(constant_id = 6) const bool BLANKED = false;
layout(constant_id = 7) const bool RECTILINEAR = false;
layout(constant_id = 8) const int NUM_SLABS = 1;

layout(buffer_reference, std430, buffer_reference_align = 16) buffer Words { uint word[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) buffer Numbers { float number[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) buffer Pairs { vec2 pair[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) buffer Entries { uvec2 entry[]; };
layout(buffer_reference, std430, buffer_reference_align = 16) buffer Quads { vec4 quad[]; };

layout(set = 0, binding = 0, std140) uniform Parameters {
    // Direction of a ray in units of the finest cells: base, and change across half a picture.
    dvec4 rate;
    dvec4 rate_x;
    dvec4 rate_y;
    // Distance of the anchors along unnormalised rays, over the step; size of a pixel in halves of
    // the picture.
    dvec4 grid;
    // A point of each ray near the volume, and its unnormalised direction, in ray space.
    vec4 anchor;
    vec4 anchor_x;
    vec4 anchor_y;
    vec4 direction;
    vec4 direction_x;
    vec4 direction_y;
    // Squared world lengths: of the direction in the middle, of its changes in x and y; w: what
    // rounding can move a computed coordinate by.
    vec4 length_sq;
    // The volume's box in ray space; w: step in cells, transmittance that ends a ray.
    vec4 box_lo;
    vec4 box_hi;
    // One over the sides of the images (x, y); what texels are multiplied by, then added (z, w).
    vec4 texel;
    // Transfer table: value at 0, bins per key, largest extinction; w: maximum intensity's threshold.
    vec4 table_scale;
    // World gradients squared as a form on ray-space gradients: xx, yy, zz; 2xy, 2xz, 2yz.
    vec4 metric_squares;
    vec4 metric_products;
    // For each axis of planes: bins a unit of the search table.
    vec4 bins_per_unit;
    // The last cell along each axis; w: one over the cells a side of a macrocell.
    vec4 last_cell;
    // Cells; w: cells that an image holds along z.
    uvec4 cells;
    // Macrocells; w: cells a side of one.
    uvec4 macrocells;
    // Where the axes begin in the buffer of planes; w: number of clip planes.
    uvec4 axis_offset;
    // Pixels a row, rows; reach of the distance map; w: devices that share the picture (upper 16
    // bits) and the number of this one.
    uvec4 picture;
    // Light where a surface is seen edge-on, what is added towards the camera, highlight.
    vec4 light;
    // Faces of the boundary, three words each: axis (2 bits), whether it looks up the axis (1 bit)
    // and number of its plane; then macrocells along the two axes that follow. For boxes, six
    // numbers each (as bits).
    Words faces;
    // What acceleration structures are built of: six corners a face.
    Numbers corners;
    // Faces of each group of lattice points, and after the scan those of all groups before it.
    Words face_counts;
    // In which order groups follow each other: the number of each one's brick.
    Words bricks;
    // Our own hierarchy over the faces, three words a node.
    Words nodes;
    // Number of these groups; what faces are wider than they are, so that no edge is missed.
    uint num_face_groups;
    float flange;
    // Number of faces or boxes, once it is known, and height of the hierarchy's root.
    uint num_shapes;
    uint tree_height;
} parameters;

layout(push_constant, std430) uniform Push {
    // RGBA16F entries of the transfer table, and for each bin the next one with any extinction.
    Entries table;
    Words next_active;
    // Ranges of macrocells; distance to the nearest active one, a byte each, and none for rays through
    // meshes that skip nothing; those being made.
    Pairs ranges;
    Words skip;
    Words skip_before;
    // Number of active macrocells.
    Words counter;
    // Planes, search tables and minima of each axis.
    Numbers planes;
    // Blanked cells, a bit each.
    Words blanked;
    // Clip planes in ray space.
    Quads clips;
    // The picture.
    Quads rgba;
    Numbers depth;
    Words samples;
    // Where rays meet what is active, as shaders with `find.glsl` found it.
    Words runs;
    // Where in the pixel rays go through.
    vec2 offset;
    // Part of a step that samples are shifted by, below 0 for none; factor on the sum of frames, 0
    // if more are to come.
    float jitter;
    float weight;
    // Number of this frame among those that are summed; of a pass: axis of the distance map, or height in the
    // hierarchy over faces.
    uint frame;
    uint pass;
} push;
