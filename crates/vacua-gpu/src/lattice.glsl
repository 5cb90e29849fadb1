// Cells and macrocells of ray space: twins of `vacua_skip::Axis` and `vacua_skip::Lattice`.
//
// Of each axis between planes the buffer holds: cells + 1 planes, 4 · cells entries of the search
// table (as bits), and the minima of cell sizes over spans of 1, 2, 4 … cells.

// Coordinate of a plane.
float plane_at(int axis, uint index) {
    if (!RECTILINEAR) return float(index);
    return push.planes.number[parameters.axis_offset[axis] + index];
}

// Coordinate of a plane between macrocells.
float macrocell_plane(int axis, uint plane) {
    return plane_at(axis, min(plane * parameters.macrocells.w, parameters.cells[axis]));
}

// The last cell that begins at or before a coordinate, clamped to the axis.
float search(int axis, float coordinate) {
    uint first = parameters.axis_offset[axis];
    uint cells = parameters.cells[axis];
    precise float scaled =
        (coordinate - push.planes.number[first]) * parameters.bins_per_unit[axis];
    uint bin = uint(clamp(scaled, 0.0, float(4 * cells - 1)));
    uint cell = floatBitsToUint(push.planes.number[first + cells + 1 + bin]);
    while (cell + 1 < cells && push.planes.number[first + cell + 1] <= coordinate) ++cell;
    return float(cell);
}

// Cells of a place in the volume's box, as whole numbers. Ends of blocks may lie outside.
vec3 cell_of(vec3 at) {
    if (RECTILINEAR) return vec3(search(0, at.x), search(1, at.y), search(2, at.z));
    return min(floor(at), parameters.last_cell.xyz);
}

// Fractions of the way through the cells, below 1.
vec3 fraction_of(vec3 at, vec3 cell) {
    precise vec3 fraction;
    if (RECTILINEAR) {
        for (int a = 0; a < 3; ++a) {
            float lo = plane_at(a, uint(cell[a]));
            float hi = plane_at(a, uint(cell[a]) + 1);
            fraction[a] = (at[a] - lo) / (hi - lo);
        }
    } else {
        fraction = at - cell;
    }
    return min(fraction, vec3(BELOW_ONE));
}

// The macrocell of a place in the volume's box, as whole numbers.
vec3 macrocell_of(vec3 at) {
    // ⌊c / K⌋ exactly: no multiple of 1/K is nearer to (c + ½)/K than ½/K.
    return trunc((cell_of(at) + 0.5) * parameters.last_cell.w);
}

// What the map of macrocells says of one: 0 if it is active. Else 128 and the Chebyshev distance to the
// nearest active one, up to a reach, if the box of it and the next one upwards along every axis holds none;
// or, below 128, which smaller boxes hold none, as `distance.comp` numbers them.
uint map_at(uvec3 macrocell) {
    uvec3 n = parameters.macrocells.xyz;
    uint index = macrocell.x + n.x * (macrocell.y + n.y * macrocell.z);
    return push.skip.word[index >> 2] >> (8 * (index & 3u)) & 255u;
}

bool is_active(uvec3 macrocell) {
    return map_at(macrocell) == 0;
}

// The distance to the nearest active macrocell that a byte of the map tells.
uint distance_of(uint byte) {
    return byte < 128u ? min(byte, 1u) : byte & 127u;
}
