//! Scientific volume rendering that skips what is empty and packs what is not.
