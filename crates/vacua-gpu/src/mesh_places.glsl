// What was found at one of a list of places.

// Writes the cell at a place, if there is one, and the value there, if it has one.
void store_value(uint index, bool is_found, Cell cell, bool is_valid, float value) {
    push.rgba.quad[index] = vec4(
        value,
        is_valid ? 1.0 : 0.0,
        uintBitsToFloat(is_found ? cell.number : NO_CELL),
        uintBitsToFloat(is_found ? cell.primitive : NO_CELL)
    );
}

// The same, of a value that is not known yet.
void store_sample(Mesh mesh, uint index, vec3 place, bool is_found, Cell cell) {
    float value = 0.0;
    bool is_valid = false;
    if (is_found) {
        Submesh part = mesh.submeshes.submesh[cell.number];
        is_valid = value_in_cell(mesh, part, cell, place, value);
    }
    store_value(index, is_found, cell, is_valid, value);
}
