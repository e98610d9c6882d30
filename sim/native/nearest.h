// Sorts things by their distance.

#ifndef DRIVETRAIN_NEAREST_H_
#define DRIVETRAIN_NEAREST_H_

#include <array>
#include <cstdint>
#include <cstring>
#include <vector>

namespace drivetrain {

struct Candidate {
  uint32_t key;  // of its squared distance
  int32_t number;
};

// The bits of a number that is not negative sort as it does.
inline uint32_t key_of(float squared) {
  uint32_t key;
  std::memcpy(&key, &squared, sizeof key);
  return key;
}

// Sorts by key, keeping the order of equals: three passes of 11 bits.
inline void sort(std::vector<Candidate>& candidates, std::vector<Candidate>& spare) {
  constexpr int kBits = 11, kPasses = 3, kBuckets = 1 << kBits;
  std::array<std::array<int32_t, kBuckets>, kPasses> starts{};
  for (const Candidate& candidate : candidates) {
    for (int pass = 0; pass < kPasses; ++pass) {
      ++starts[pass][candidate.key >> (kBits * pass) & (kBuckets - 1)];
    }
  }
  for (auto& counts : starts) {
    int32_t total = 0;
    for (int32_t& count : counts) {
      const int32_t here = count;
      count = total;
      total += here;
    }
  }
  spare.resize(candidates.size());
  for (int pass = 0; pass < kPasses; ++pass) {
    for (const Candidate& candidate : candidates) {
      spare[starts[pass][candidate.key >> (kBits * pass) & (kBuckets - 1)]++] =
          candidate;
    }
    candidates.swap(spare);
  }
}

}  // namespace drivetrain

#endif  // DRIVETRAIN_NEAREST_H_
