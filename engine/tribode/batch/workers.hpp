#pragma once
#include "tribode/base/run_control.hpp"
#include "tribode/batch/batch_files.hpp"

#include <filesystem>
#include <vector>

namespace tribode {

// Only one of `run` and `resume` may work in the folder of a batch. Held until destroyed, or until the process ends in
// whatever way. Throws InputError where another process holds it, OutputError where the folder cannot be written to.
class FolderLock {
  public:
    explicit FolderLock(const std::filesystem::path& folder);
    ~FolderLock();
    FolderLock(const FolderLock&) = delete;
    FolderLock& operator=(const FolderLock&) = delete;

  private:
    int file_ = -1;
};

// Runs shards on control.workers processes, each shard in a process of its own that is a copy of this one (fork): what a
// point does to its process, up to its crash, ends with it. The caller must have no other threads.
//
// A process that crashes (segmentation fault, abort, ...) is started again where its points ended; the point that crashed
// it twice is a row with the reason. One that is killed from outside is started again, and a point during which that
// happened eight times is a row with the reason, too.
//
// Returns false where a stop was requested: the shards end at a point boundary. Throws OutputError where the disk does not
// take the results, after all processes have ended.
bool run_shards(const std::filesystem::path& folder, const Manifest& manifest, const Batch& batch,
                const std::vector<std::size_t>& shards, const RunControl& control);

} // namespace tribode
