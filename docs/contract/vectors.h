/* Reads arrays of a test vector in C and C++, on a little-endian machine: values(FILE, "CASE/NAME", &count), NULL where there is none. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static double *values(const char *file, const char *name, long *count)
{
    FILE *stream = fopen(file, "rb");
    if (!stream || fseek(stream, 0, SEEK_END))
        return NULL;
    const long length = ftell(stream);
    char *bytes = (char *)calloc(length + 1, 1), wanted[200];
    rewind(stream);
    if (fread(bytes, 1, length, stream) != (size_t)length)
        return NULL;
    fclose(stream);
    const int size = snprintf(wanted, sizeof wanted, "%s.npy", name);
    for (char *p = bytes; p + 30 + size < bytes + length; p++) {
        if (memcmp(p, "PK\3\4", 4) || *(uint16_t *)(p + 26) != size || memcmp(p + 30, wanted, size))
            continue; /* not the head of this entry of the zip file */
        const char *npy = p + 30 + size + *(uint16_t *)(p + 28), *data = npy + 10 + *(uint16_t *)(npy + 8);
        const char *type = strstr(npy + 10, "'descr': '") + 11;
        long rows = 1, columns = 1;
        sscanf(strstr(npy + 10, "'shape': (") + 10, "%ld, %ld", &rows, &columns);
        double *found = (double *)malloc((*count = rows * columns) * sizeof(double) + 1);
        for (long k = 0; k < *count; k++, data += type[1] - '0')
            found[k] = !strncmp(type, "f8", 2) ? *(double *)data : !strncmp(type, "f4", 2) ? *(float *)data
                     : !strncmp(type, "i4", 2) ? *(int32_t *)data : *(uint8_t *)data;
        return found;
    }
    return NULL;
}
