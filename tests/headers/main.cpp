// SPDX-License-Identifier: MIT
// Linked with one unit per public header; that this program links is the test.
int main() {}
