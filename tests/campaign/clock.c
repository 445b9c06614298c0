/* A time of day that is wrong, for one process: loaded into the server by LD_PRELOAD. It is off by the number of seconds in
 * SWARMBENCH_CLOCK_OFF, where SWARMBENCH_CLOCK_FILE is given only while there is that file. Other clocks are as they are. It calls nothing that needs memory, as it may run before all else.
 */
#define _GNU_SOURCE
#include <stdlib.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *now)
{
    int failed = (int)syscall(SYS_clock_gettime, clock, now);
    const char *off = getenv("SWARMBENCH_CLOCK_OFF");
    const char *file = getenv("SWARMBENCH_CLOCK_FILE");
    if (!failed && clock == CLOCK_REALTIME && off && (!file || access(file, F_OK) == 0))
        now->tv_sec += atoi(off);
    return failed;
}
