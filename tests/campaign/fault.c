/* A disk that fails on demand, for one process: loaded into the server by LD_PRELOAD.
 *
 * As long as the file named by SWARMBENCH_FAULT exists, writes to files whose names end in ".db" or
 * "-wal" go wrong as its text says:
 *
 *   enospc   a write fails with ENOSPC
 *   eio      a write, or a change of the length, fails with EIO
 *   torn     half of a write reaches the file, then it fails with ENOSPC
 *   sync     fsync and fdatasync fail with EIO, after they have worked
 *   short    a write takes only half of the bytes and says so, which POSIX allows
 *
 * Each time, a byte is added to the file of that name with ".hits" at its end.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define REAL(name) \
    static __typeof__(&name) real; \
    if (!real) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

static ssize_t plain_write(int fd, const void *bytes, size_t count)
{
    static ssize_t (*real)(int, const void *, size_t);
    if (!real) real = (ssize_t (*)(int, const void *, size_t))dlsym(RTLD_NEXT, "write");
    return real(fd, bytes, count);
}

static int ends_with(const char *text, const char *end)
{
    size_t length = strlen(text), part = strlen(end);
    return length >= part && strcmp(text + length - part, end) == 0;
}

/* Whether a descriptor is one of the database's files. */
static int is_database(int fd)
{
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return ends_with(path, ".db") || ends_with(path, "-wal");
}

/* What goes wrong with this descriptor now; an empty text for nothing. errno stays as it was. */
static void fault(int fd, char *kind, size_t size)
{
    int before = errno;
    kind[0] = 0;
    const char *control = getenv("SWARMBENCH_FAULT");
    int file = control ? open(control, O_RDONLY | O_CLOEXEC) : -1;
    if (file >= 0) {
        ssize_t length = is_database(fd) ? read(file, kind, size - 1) : 0;
        kind[length > 0 ? length : 0] = 0;
        close(file);
    }
    errno = before;
}

/* Notes that something went wrong. */
static void hit(void)
{
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%s.hits", getenv("SWARMBENCH_FAULT"));
    int file = open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    if (file < 0) return;
    if (plain_write(file, ".", 1) != 1) abort();
    close(file);
}

/* How many bytes of a write still reach the file; `*failure` is the error that it ends with, or 0. */
static size_t allowed(int fd, size_t count, int *failure)
{
    char kind[16];
    fault(fd, kind, sizeof kind);
    *failure = 0;
    size_t taken = count;
    if (strcmp(kind, "enospc") == 0) { taken = 0; *failure = ENOSPC; }
    else if (strcmp(kind, "eio") == 0) { taken = 0; *failure = EIO; }
    else if (strcmp(kind, "torn") == 0) { taken = count / 2; *failure = ENOSPC; }
    else if (strcmp(kind, "short") == 0 && count > 1) { taken = count / 2; }
    if (*failure || taken < count) hit();
    return taken;
}

#define WRITE(call) \
    int failure; \
    size_t taken = allowed(fd, count, &failure); \
    if (!failure) return call; \
    if (taken > 0 && call < 0) return -1; \
    errno = failure; \
    return -1

ssize_t write(int fd, const void *bytes, size_t count)
{
    REAL(write);
    WRITE(real(fd, bytes, taken));
}

ssize_t pwrite(int fd, const void *bytes, size_t count, off_t at)
{
    REAL(pwrite);
    WRITE(real(fd, bytes, taken, at));
}

ssize_t pwrite64(int fd, const void *bytes, size_t count, off64_t at)
{
    REAL(pwrite64);
    WRITE(real(fd, bytes, taken, at));
}

static int is(int fd, const char *expected)
{
    char kind[16];
    fault(fd, kind, sizeof kind);
    if (strcmp(kind, expected) != 0) return 0;
    hit();
    return 1;
}

#define SYNC(name) \
    int name(int fd) \
    { \
        REAL(name); \
        int done = real(fd); \
        if (!is(fd, "sync")) return done; \
        errno = EIO; \
        return -1; \
    }

SYNC(fsync)
SYNC(fdatasync)

#define TRUNCATE(name, type) \
    int name(int fd, type length) \
    { \
        REAL(name); \
        if (!is(fd, "eio")) return real(fd, length); \
        errno = EIO; \
        return -1; \
    }

TRUNCATE(ftruncate, off_t)
TRUNCATE(ftruncate64, off64_t)
