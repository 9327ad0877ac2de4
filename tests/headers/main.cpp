// SPDX-License-Identifier: MIT
// Linked with two units of every public header; that this program links is the test.
int main() {}
