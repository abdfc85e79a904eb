#include "common/thread_pool.hpp"

#include <algorithm>
#include <chrono>
#include <system_error>

namespace romgrl {
namespace {

constexpr std::chrono::microseconds kPatience(100);
constexpr int kLooks = 1000;  // about a microsecond, between two system calls

// True as soon as the condition holds, false if it does not for a while.
template <typename Condition>
bool spin(const Condition& condition) {
    const auto end = std::chrono::steady_clock::now() + kPatience;
    do {
        for (int look = 0; look < kLooks; ++look) {
            if (condition()) return true;
        }
        std::this_thread::yield();
    } while (std::chrono::steady_clock::now() < end);
    return false;
}

}  // namespace

Pool::Pool(int threads) : parts_(threads) {
    try {
        for (int i = 1; i < threads; ++i) threads_.emplace_back([this, i] { serve(i); });
    } catch (const std::system_error&) {
        // The system has no more threads: those that started, and the caller, do the work.
    }
}

Pool::~Pool() {
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        closing_ = true;
    }
    start_.notify_all();
    for (std::thread& thread : threads_) thread.join();
}

void Pool::take(int own) {
    const int parts = static_cast<int>(parts_.size());
    for (int i = 0; i < parts; ++i) {
        Part& part = parts_[(own + i) % parts];
        for (int begin = part.next.fetch_add(chunk_); begin < part.end; begin = part.next.fetch_add(chunk_)) {
            (*work_)(begin, std::min(begin + chunk_, part.end));
        }
    }
}

void Pool::run(int total, const Work& work) {
    if (threads_.empty()) {
        work(0, total);
        return;
    }
    work_ = &work;
    const int parts = static_cast<int>(parts_.size());
    chunk_ = std::max(1, total / (8 * parts));
    for (int i = 0; i < parts; ++i) {
        parts_[i].next = static_cast<int>(static_cast<long>(total) * i / parts);
        parts_[i].end = static_cast<int>(static_cast<long>(total) * (i + 1) / parts);
    }
    gate_ -= kClosed;
    ++round_;
    if (sleeping_ > 0) {
        { const std::lock_guard<std::mutex> lock(mutex_); }
        start_.notify_all();
    }
    take(0);
    gate_ += kClosed;
    const auto alone = [this] { return gate_ == kClosed; };
    if (spin(alone)) return;
    std::unique_lock<std::mutex> lock(mutex_);
    finish_.wait(lock, alone);
}

void Pool::leave() {
    if (--gate_ != kClosed) return;
    { const std::lock_guard<std::mutex> lock(mutex_); }
    finish_.notify_one();
}

bool Pool::wait_for_round(unsigned long seen) {
    const auto called = [this, seen] { return closing_ || round_ != seen; };
    if (!spin(called)) {
        std::unique_lock<std::mutex> lock(mutex_);
        ++sleeping_;
        start_.wait(lock, called);
        --sleeping_;
    }
    return !closing_;
}

void Pool::serve(int own) {
    unsigned long seen = 0;
    while (wait_for_round(seen)) {
        seen = round_;
        if (++gate_ < kClosed) take(own);  // else too late: the round is over
        leave();
    }
}

}  // namespace romgrl
