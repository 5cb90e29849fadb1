// The transfer table in shared memory, for the compute shaders that sample.

// Transfer table as halves: red and green, blue and extinction; and both ends of each bin's
// extinction, which is all that most samples ask for. A filtered image of colours in place of the
// first was 9 to 16 % slower on an H100, whose texture units are what bounds this shader.
shared uvec2 colors[TRANSFER_BINS + 1];
shared uint extinctions[TRANSFER_BINS];

uvec2 table_entry(uint index) {
    return colors[index];
}

uint table_ends(uint bin) {
    return extinctions[bin];
}

// Brings the transfer table.
void bring_table() {
    for (uint i = gl_LocalInvocationIndex; i <= TRANSFER_BINS; i += gl_WorkGroupSize.x) {
        uvec2 entry = push.table.entry[i];
        colors[i] = entry;
        if (i < TRANSFER_BINS) {
            uvec2 next = push.table.entry[i + 1];
            extinctions[i] = entry.y >> 16 | next.y & 0xffff0000u;
        }
    }
    barrier();
}
