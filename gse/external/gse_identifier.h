/* gse_identifier.h: the border between the ground test station (gse) and an identifier in a shared library.
 *
 *   int identify(const gse_panorama *panorama, gse_answer *answer, void *config);
 *
 * The station loads the library in a process of its own, writes one panorama, calls the function, reads the answer.
 * All structs are plain, with fixed-width types and without padding; no pointer is kept, no memory is handed over, no
 * function is called back. Positions and index values are raw counts of the wire, in the order of the wire;
 * gse_sensor says what a count is. docs/external-identifiers.md explains every field.
 */
#ifndef GSE_IDENTIFIER_H
#define GSE_IDENTIFIER_H

#include <stdint.h>

#define GSE_IDENTIFIER_ABI 1u
#define GSE_MOST_OBJECTS 30

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    double factor; /* value = factor * count + zero; px for y and x (0-based at pixel centres), index values for index */
    double zero;
} gse_unit;

typedef struct {
    uint32_t version; /* GSE_IDENTIFIER_ABI */
    uint32_t rows;
    uint32_t columns;
    uint32_t mirrored; /* 1: x is flipped before directions are computed */
    double focal_length_px;
    double principal_point_px[2];      /* x, y */
    double radial_distortion[2];       /* k1, k2 */
    double tangential_distortion[2];   /* p1, p2 */
    double index_max;
    gse_unit y, x, index;
} gse_sensor;

typedef struct {
    double y, x, index; /* counts */
} gse_object;

typedef struct {
    uint32_t version; /* GSE_IDENTIFIER_ABI */
    uint32_t frame_no;
    int64_t utc_ns;    /* nanoseconds since 1970-01-01T00:00:00Z, without leap seconds; 0: not known */
    uint64_t time_us;  /* the sensor's own clock */
    uint32_t exposure_us;
    uint32_t count;    /* objects that are used */
    gse_object objects[GSE_MOST_OBJECTS];
} gse_panorama;

typedef struct {
    int64_t star;    /* number in the station's catalogue (Gaia DR3, HIP or HR) */
    uint32_t object; /* 0 .. count - 1 of the panorama */
    uint32_t spare;
} gse_match;

enum gse_status {
    GSE_NOT_SET = 0, /* as the station hands it over */
    GSE_IDENTIFIED = 1,
    GSE_TOO_FEW = 2,
    GSE_NO_MATCH = 3,
    GSE_AMBIGUOUS = 4,
    GSE_SENSOR_FAULT = 5
};

typedef struct {
    uint32_t version;  /* set it to GSE_IDENTIFIER_ABI */
    uint32_t frame_no; /* set it to that of the panorama */
    uint32_t status;   /* enum gse_status */
    uint32_t matched;  /* matches that are used; may be 0 */
    double ra_deg;     /* of the boresight, ICRS, not corrected for aberration or refraction */
    double de_deg;
    double roll_deg;   /* position angle of image up; NaN, as handed over: not known */
    double elapsed_us; /* processing time; NaN, as handed over: the station takes the time of the call */
    gse_match matches[GSE_MOST_OBJECTS];
    char detail[64];   /* one line, why there is no answer; may be empty */
} gse_answer;

typedef struct {
    uint32_t version; /* GSE_IDENTIFIER_ABI */
    uint32_t spare;
    const gse_sensor *sensor;
    const uint8_t *data; /* content of the file `config` of the station file; NULL without one */
    uint64_t size;
    void *state; /* the library's own; NULL at the first call */
} gse_config;

/* 0: the answer is set. Any other number: no answer, and the number is reported. */
typedef int gse_identify(const gse_panorama *panorama, gse_answer *answer, void *config);

/* Put GSE_IDENTIFIER("name", "version") into one file: the station checks the ABI before a session, and reports both. */
#define GSE_IDENTIFIER(NAME, VERSION)                              \
    const uint32_t gse_identifier_abi = GSE_IDENTIFIER_ABI;        \
    const char gse_identifier_name[] = NAME;                       \
    const char gse_identifier_version[] = VERSION

#ifdef __cplusplus
}
#endif
#endif
