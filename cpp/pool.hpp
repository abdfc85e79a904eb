// Worker threads that live as long as their batch and share the items of a loop in small chunks.
//
// Chunks are taken, not assigned: on a busy machine the caller does the work of a thread that is not scheduled, instead of
// waiting for it. (64 worlds, 2 threads, other work on both cores: assigned halves ran at half the speed of one thread.)
// A step takes some ten microseconds and waking a thread as many, so a thread without work looks for more, yielding its
// core, for a moment before it sleeps.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace romgrl {

class Pool {
  public:
    using Work = std::function<void(int, int)>;  // items begin to end

    explicit Pool(int threads);  // the caller is one of them
    ~Pool();
    Pool(const Pool&) = delete;
    Pool& operator=(const Pool&) = delete;

    // Calls `work` on all of 0..total in chunks, on any thread in any order; returns when all are done. Work must not throw.
    void run(int total, const Work& work);

  private:
    void serve();
    void take(const Work& work, int total, int chunk);

    std::mutex mutex_;
    std::condition_variable start_, finish_;
    std::vector<std::thread> threads_;
    std::atomic<int> next_{0}, busy_{0};
    std::atomic<unsigned long> round_{0};
    const Work* work_ = nullptr;  // null: nothing to do
    int total_ = 0, chunk_ = 1;
    bool closing_ = false;
};

}  // namespace romgrl
