// What the ray generation shaders share: the transfer table in memory, as they have none to share
// among them, and one ray a pixel, each at its own pace.

uvec2 table_entry(uint index) {
    return push.table.entry[index];
}

// Both ends of a bin's extinction lie in one word, behind the entries.
uint table_ends(uint bin) {
    return Words(push.table).word[2 * (TRANSFER_BINS + 2) + bin];
}

uint first_wanted(uint wanted) {
    return wanted;
}
