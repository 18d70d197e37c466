/* What a program asks of the disk, seen from below it: LD_PRELOAD this and every operation on files under $CRASH_ROOT is written
 * to $CRASH_LOG in its order, with its data. It can also play a disk of a given size.
 *
 * One lock is held over the call and its record, so that the order in the log is the order in which things happened. A record is
 * { u32 op, u32 path bytes, u32 path2 bytes, u32 data bytes, u64 inode, i64 offset, u64 monotonic ns } and then the three.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum { CREATE = 1, WRITE, TRUNCATE, SYNC, RENAME, UNLINK, MKDIR, SYNC_FOLDER, MARK, RMDIR };

struct record { uint32_t op, path, path2, data; uint64_t inode; int64_t offset; uint64_t ns; };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static char root[PATH_MAX], log_path[PATH_MAX];
static size_t root_length;
static int log_fd = -1;
static int64_t free_bytes = -1;       /* of the disk that is played; -1: the real one */
static int64_t fail_at = -1, fail_count; /* the write, counted from now, that finds the disk full, and how many do */
static int fail_short;
static uint64_t writes_seen;

#define REAL(name) ((__typeof__(&name))real(#name))
static void *real(const char *name) {
    void *found = dlsym(RTLD_NEXT, name);
    if (!found) abort();
    return found;
}

static void emit(uint32_t op, uint64_t inode, int64_t offset, const char *path, const char *path2, const void *data, size_t size) {
    if (log_fd < 0) {
        if (!log_path[0]) return;
        log_fd = REAL(open)(log_path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
        if (log_fd < 0) abort();
    }
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    struct record head = {op, path ? strlen(path) : 0, path2 ? strlen(path2) : 0, size, inode, offset,
                          (uint64_t)now.tv_sec * 1000000000u + now.tv_nsec};
    struct iovec parts[4] = {{&head, sizeof head}, {(void *)path, head.path}, {(void *)path2, head.path2}, {(void *)data, size}};
    size_t whole = sizeof head + head.path + head.path2 + size;
    if (REAL(writev)(log_fd, parts, 4) != (ssize_t)whole) abort();
}

__attribute__((constructor)) static void begin(void) {
    const char *named = getenv("CRASH_ROOT"), *log = getenv("CRASH_LOG"), *room = getenv("CRASH_FREE");
    if (named && realpath(named, root)) root_length = strlen(root);
    if (log) strncpy(log_path, log, sizeof log_path - 1);
    if (room) free_bytes = atoll(room);
}

/* Called by the program that is watched, through ctypes. */

void crash_mark(const char *text) {
    pthread_mutex_lock(&lock);
    emit(MARK, 0, 0, NULL, NULL, text, strlen(text));
    pthread_mutex_unlock(&lock);
}

/* From now on what is below `folder` is watched, into `log` (or nowhere). */
void crash_watch(const char *folder, const char *log) {
    pthread_mutex_lock(&lock);
    if (log_fd >= 0) REAL(close)(log_fd);
    log_fd = -1;
    root_length = realpath(folder, root) ? strlen(root) : 0;
    strncpy(log_path, log, sizeof log_path - 1);
    writes_seen = 0;
    pthread_mutex_unlock(&lock);
}

/* The `at`th write from now and the `count - 1` after it find the disk full; `half`: the first of them still writes a half. */
void crash_fail(int64_t at, int64_t count, int half) {
    pthread_mutex_lock(&lock);
    fail_at = at, fail_count = count, fail_short = half, writes_seen = 0;
    pthread_mutex_unlock(&lock);
}

uint64_t crash_writes(void) { return writes_seen; }

/* The disk has so many bytes left; -1: as many as there really are. */
void crash_room(int64_t bytes) {
    pthread_mutex_lock(&lock);
    free_bytes = bytes;
    pthread_mutex_unlock(&lock);
}

int64_t crash_room_left(void) { return free_bytes; }

static int watched_path(int folder, const char *path, char *whole) {
    char joined[PATH_MAX];
    if (!root_length || !path) return 0;
    if (path[0] == '/') {
        if (strlen(path) >= sizeof joined) return 0;
        strcpy(joined, path);
    } else {
        ssize_t length;
        if (folder == AT_FDCWD) {
            if (!getcwd(joined, sizeof joined)) return 0;
            length = strlen(joined);
        } else {
            char link[64];
            char *end = link + strlen(strcpy(link, "/proc/self/fd/"));
            char digits[16];
            int count = 0, number = folder;
            do digits[count++] = '0' + number % 10; while (number /= 10);
            while (count) *end++ = digits[--count];
            *end = 0;
            length = readlink(link, joined, sizeof joined - 1);
            if (length < 0) return 0;
        }
        if (length + strlen(path) + 2 > sizeof joined) return 0;
        joined[length] = '/';
        strcpy(joined + length + 1, path);
    }
    if (strncmp(joined, root, root_length) || (joined[root_length] && joined[root_length] != '/')) return 0;
    strcpy(whole, joined[root_length] ? joined + root_length + 1 : "");
    return 1;
}

static int watched_file(int fd, char *path, struct stat *found) {
    char link[64], target[PATH_MAX], digits[16];
    if (!root_length || fd < 0 || fd == log_fd || fstat(fd, found)) return 0;
    if (!S_ISREG(found->st_mode) && !S_ISDIR(found->st_mode)) return 0;
    char *end = link + strlen(strcpy(link, "/proc/self/fd/"));
    int count = 0, number = fd;
    do digits[count++] = '0' + number % 10; while (number /= 10);
    while (count) *end++ = digits[--count];
    *end = 0;
    ssize_t length = readlink(link, target, sizeof target - 1);
    if (length < 0) return 0;
    target[length] = 0;
    if (strncmp(target, root, root_length) || (target[root_length] && target[root_length] != '/')) return 0;
    strcpy(path, target[root_length] ? target + root_length + 1 : "");
    return 1;
}

/* How much of `size` bytes at `offset` the disk takes; -1 with errno where it takes none. */
static ssize_t granted(const struct stat *file, int64_t offset, size_t size) {
    writes_seen++;
    if (fail_at > 0 && (int64_t)writes_seen >= fail_at && (int64_t)writes_seen < fail_at + fail_count) {
        if (fail_short && (int64_t)writes_seen == fail_at && size > 1) return size / 2;
        errno = ENOSPC;
        return -1;
    }
    if (free_bytes < 0) return size;
    int64_t growth = offset + (int64_t)size - file->st_size;
    if (growth <= 0) return size;
    if (growth > free_bytes) {
        ssize_t fits = (ssize_t)size - (growth - free_bytes);
        if (fits <= 0) {
            errno = ENOSPC;
            return -1;
        }
        free_bytes = 0;
        return fits;
    }
    free_bytes -= growth;
    return size;
}

static void given_back(int64_t bytes) {
    if (free_bytes >= 0) free_bytes += bytes;
}

static int opened(int folder, const char *path, int flags, mode_t mode) {
    char whole[PATH_MAX];
    struct stat before, after;
    if (!(flags & (O_CREAT | O_TRUNC)) || (flags & O_TMPFILE) == O_TMPFILE) return REAL(openat)(folder, path, flags, mode);
    pthread_mutex_lock(&lock);
    int watched = watched_path(folder, path, whole);
    int existed = watched && !fstatat(folder, path, &before, 0);
    int fd = REAL(openat)(folder, path, flags, mode);
    if (fd >= 0 && watched && !fstat(fd, &after)) {
        if (!existed) emit(CREATE, after.st_ino, after.st_mode & 07777, whole, NULL, NULL, 0);
        else if ((flags & O_TRUNC) && before.st_size) {
            emit(TRUNCATE, after.st_ino, 0, whole, NULL, NULL, 0);
            given_back(before.st_size);
        }
    }
    int error = errno;
    pthread_mutex_unlock(&lock);
    errno = error;
    return fd;
}

#define MODE_OF(flags, mode) \
    mode_t mode = 0; \
    if ((flags) & (O_CREAT | O_TMPFILE)) { va_list rest; va_start(rest, flags); mode = va_arg(rest, mode_t); va_end(rest); }

int open(const char *path, int flags, ...) { MODE_OF(flags, mode) return opened(AT_FDCWD, path, flags, mode); }
int open64(const char *path, int flags, ...) { MODE_OF(flags, mode) return opened(AT_FDCWD, path, flags | O_LARGEFILE, mode); }
int openat(int folder, const char *path, int flags, ...) { MODE_OF(flags, mode) return opened(folder, path, flags, mode); }
int openat64(int folder, const char *path, int flags, ...) { MODE_OF(flags, mode) return opened(folder, path, flags | O_LARGEFILE, mode); }
int creat(const char *path, mode_t mode) { return opened(AT_FDCWD, path, O_CREAT | O_WRONLY | O_TRUNC, mode); }

static ssize_t written(int fd, const void *data, size_t size, off_t offset, int positioned) {
    char path[PATH_MAX];
    struct stat file;
    pthread_mutex_lock(&lock);
    int watched = watched_file(fd, path, &file);
    ssize_t done;
    if (!watched) {
        pthread_mutex_unlock(&lock);
        return positioned ? REAL(pwrite)(fd, data, size, offset) : REAL(write)(fd, data, size);
    }
    if (!positioned) offset = (fcntl(fd, F_GETFL) & O_APPEND) ? file.st_size : lseek(fd, 0, SEEK_CUR);
    done = granted(&file, offset, size);
    if (done >= 0) done = positioned ? REAL(pwrite)(fd, data, done, offset) : REAL(write)(fd, data, done);
    if (done > 0) emit(WRITE, file.st_ino, offset, path, NULL, data, done);
    int error = errno;
    pthread_mutex_unlock(&lock);
    errno = error;
    return done;
}

ssize_t write(int fd, const void *data, size_t size) { return written(fd, data, size, 0, 0); }
ssize_t pwrite(int fd, const void *data, size_t size, off_t offset) { return written(fd, data, size, offset, 1); }
ssize_t pwrite64(int fd, const void *data, size_t size, off64_t offset) { return written(fd, data, size, offset, 1); }

/* Gathered into one: the parts of a vector reach the disk as one write does. */
static ssize_t gathered(int fd, const struct iovec *parts, int count, off_t offset, int positioned) {
    size_t size = 0;
    for (int k = 0; k < count; k++) size += parts[k].iov_len;
    char *whole = malloc(size + 1), *end = whole;
    for (int k = 0; k < count; k++) end = mempcpy(end, parts[k].iov_base, parts[k].iov_len);
    ssize_t done = written(fd, whole, size, offset, positioned);
    free(whole);
    return done;
}

ssize_t writev(int fd, const struct iovec *parts, int count) { return gathered(fd, parts, count, 0, 0); }
ssize_t pwritev(int fd, const struct iovec *parts, int count, off_t offset) { return gathered(fd, parts, count, offset, 1); }

static int synced(int fd, int only_data) {
    char path[PATH_MAX];
    struct stat file;
    pthread_mutex_lock(&lock);
    int watched = watched_file(fd, path, &file);
    int failed = only_data ? REAL(fdatasync)(fd) : REAL(fsync)(fd);
    if (!failed && watched) emit(S_ISDIR(file.st_mode) ? SYNC_FOLDER : SYNC, file.st_ino, 0, path, NULL, NULL, 0);
    int error = errno;
    pthread_mutex_unlock(&lock);
    errno = error;
    return failed;
}

int fsync(int fd) { return synced(fd, 0); }
int fdatasync(int fd) { return synced(fd, 1); }

int ftruncate(int fd, off_t size) {
    char path[PATH_MAX];
    struct stat file;
    pthread_mutex_lock(&lock);
    int watched = watched_file(fd, path, &file);
    int failed = REAL(ftruncate)(fd, size);
    if (!failed && watched) {
        emit(TRUNCATE, file.st_ino, size, path, NULL, NULL, 0);
        if (size < file.st_size) given_back(file.st_size - size);
    }
    int error = errno;
    pthread_mutex_unlock(&lock);
    errno = error;
    return failed;
}
int ftruncate64(int fd, off64_t size) { return ftruncate(fd, size); }

/* SQLite asks for room in its shared memory only, which no cut preserves: refused, it writes zeros instead. */
int posix_fallocate(int fd, off_t offset, off_t size) { (void)fd; (void)offset; (void)size; return EINVAL; }
int fallocate(int fd, int mode, off_t offset, off_t size) { (void)fd; (void)mode; (void)offset; (void)size; errno = EOPNOTSUPP; return -1; }

int renameat(int folder, const char *from, int folder2, const char *to) {
    char old[PATH_MAX], new[PATH_MAX];
    struct stat file, target;
    pthread_mutex_lock(&lock);
    int watched = watched_path(folder, from, old) && watched_path(folder2, to, new);
    int known = watched && !fstatat(folder, from, &file, AT_SYMLINK_NOFOLLOW);
    int over = watched && !fstatat(folder2, to, &target, AT_SYMLINK_NOFOLLOW);
    int failed = REAL(renameat)(folder, from, folder2, to);
    if (!failed && known) {
        emit(RENAME, file.st_ino, 0, old, new, NULL, 0);
        if (over && target.st_ino != file.st_ino && S_ISREG(target.st_mode)) given_back(target.st_size);
    }
    int error = errno;
    pthread_mutex_unlock(&lock);
    errno = error;
    return failed;
}
int rename(const char *from, const char *to) { return renameat(AT_FDCWD, from, AT_FDCWD, to); }
int renameat2(int folder, const char *from, int folder2, const char *to, unsigned flags) {
    if (flags) { errno = EINVAL; return -1; }
    return renameat(folder, from, folder2, to);
}

int unlinkat(int folder, const char *path, int flags) {
    char whole[PATH_MAX];
    struct stat file;
    pthread_mutex_lock(&lock);
    int watched = watched_path(folder, path, whole) && !fstatat(folder, path, &file, AT_SYMLINK_NOFOLLOW);
    int failed = REAL(unlinkat)(folder, path, flags);
    if (!failed && watched) {
        emit((flags & AT_REMOVEDIR) ? RMDIR : UNLINK, file.st_ino, 0, whole, NULL, NULL, 0);
        if (S_ISREG(file.st_mode)) given_back(file.st_size);
    }
    int error = errno;
    pthread_mutex_unlock(&lock);
    errno = error;
    return failed;
}
int unlink(const char *path) { return unlinkat(AT_FDCWD, path, 0); }
int rmdir(const char *path) { return unlinkat(AT_FDCWD, path, AT_REMOVEDIR); }

int mkdirat(int folder, const char *path, mode_t mode) {
    char whole[PATH_MAX];
    pthread_mutex_lock(&lock);
    int watched = watched_path(folder, path, whole);
    int failed = REAL(mkdirat)(folder, path, mode);
    if (!failed && watched) emit(MKDIR, 0, 0, whole, NULL, NULL, 0);
    int error = errno;
    pthread_mutex_unlock(&lock);
    errno = error;
    return failed;
}
int mkdir(const char *path, mode_t mode) { return mkdirat(AT_FDCWD, path, mode); }

int statvfs(const char *path, struct statvfs *found) {
    char whole[PATH_MAX];
    int failed = REAL(statvfs)(path, found);
    if (!failed && free_bytes >= 0 && watched_path(AT_FDCWD, path, whole)) {
        found->f_bfree = found->f_bavail = free_bytes / found->f_frsize;
    }
    return failed;
}
int statvfs64(const char *path, struct statvfs64 *found) {
    struct statvfs small;
    int failed = statvfs(path, &small);
    memcpy(found, &small, sizeof small);
    return failed;
}
int fstatvfs(int fd, struct statvfs *found) {
    char path[PATH_MAX];
    struct stat file;
    int failed = REAL(fstatvfs)(fd, found);
    if (!failed && free_bytes >= 0 && watched_file(fd, path, &file)) {
        found->f_bfree = found->f_bavail = free_bytes / found->f_frsize;
    }
    return failed;
}
