// Values of the volume. Texels come as the format gives them (0 to 1 for integers); what is computed
// from them becomes a value as it is rendered by one multiplication and one addition, each monotone,
// and exact for whole numbers where the format's conversion rounds correctly.

layout(set = 0, binding = 1) uniform sampler2DArray images[MAX_SLABS];

// First layer of the volume that an image holds: one before its cells.
int first_layer(int slab) {
    return max(slab * int(parameters.cells.w) - 1, 0);
}

// The image that holds a cell.
int slab_of(float cell_z) {
    return NUM_SLABS == 1 ? 0 : min(int(cell_z) / int(parameters.cells.w), NUM_SLABS - 1);
}

// Four texels around a corner between texels, of one layer of the volume: with `corner` (x, y)
// those of columns x − 1 and x and rows y − 1 and y. In Vulkan's order: (x − 1, y), (x, y),
// (x, y − 1), (x − 1, y − 1).
vec4 gather(int slab, vec2 corner, float layer) {
    vec2 uv = corner * parameters.texel.xy;
    if (NUM_SLABS == 1) return textureGather(images[0], vec3(uv, layer));
    float in_slab = layer - float(first_layer(slab));
    return textureGather(images[nonuniformEXT(slab)], vec3(uv, in_slab));
}

// One texel.
float fetch(vec3 cell) {
    if (NUM_SLABS == 1) return texelFetch(images[0], ivec3(cell), 0).r;
    int slab = slab_of(cell.z);
    ivec3 at = ivec3(cell.xy, int(cell.z) - first_layer(slab));
    return texelFetch(images[nonuniformEXT(slab)], at, 0).r;
}

// A value as it is rendered.
float value_of(float texel) {
    precise float scaled = texel * parameters.texel.z;
    precise float value = scaled + parameters.texel.w;
    return value;
}

bool is_finite(float value) {
    return (floatBitsToUint(value) & 0x7f800000u) != 0x7f800000u;
}

// Whether a cell holds nothing to see.
bool is_blanked(vec3 cell) {
    if (!BLANKED) return false;
    uvec3 n = parameters.cells.xyz;
    uint index = uint(cell.x) + n.x * (uint(cell.y) + n.y * uint(cell.z));
    return (push.blanked.word[index >> 5] >> (index & 31u) & 1u) != 0u;
}
