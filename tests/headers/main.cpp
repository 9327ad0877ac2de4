// SPDX-License-Identifier: MIT
// Linked with two units of every header that needs more than Eigen; that this program links is the test.
int main() {}
