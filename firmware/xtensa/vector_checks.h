// tests/vectors/*.json against the core's codecs.
#pragma once

// Prints one line per table with a CRC of what came out; returns how many vectors did not give what they say.
int check_vectors();
