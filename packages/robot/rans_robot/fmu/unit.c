/* A functional mock-up unit: FMI 2.0 for co-simulation, around what unit.h asks of an agent.
 *
 * The types and values below are declared after the FMI 2.0.4 specification (sections 2.1 and 4.2); no header of the
 * standard is part of this file.
 */
#include "unit.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Byte;
typedef const char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef int fmi2StatusKind;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    unit *own;
    const fmi2CallbackFunctions *functions; /* NULL: nobody listens */
    char name[64];
} instance;

/* Tell the simulator what is wrong, if anything. */
static fmi2Status answered(const instance *self, const char *wrong) {
    if (wrong == NULL) {
        return fmi2OK;
    }
    if (self->functions != NULL && self->functions->logger != NULL) {
        /* As the format itself, in which no per cent stands: some simulators do not fill formats. */
        self->functions->logger(self->functions->componentEnvironment, self->name, fmi2Error, "logStatusError", wrong);
    }
    return fmi2Error;
}

EXPORTED const char *fmi2GetTypesPlatform(void) { return "default"; }

EXPORTED const char *fmi2GetVersion(void) { return "2.0"; }

EXPORTED fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String names[]) {
    (void)c, (void)on, (void)count, (void)names;
    return fmi2OK;
}

EXPORTED fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                       const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                                       fmi2Boolean logging) {
    instance *self;
    (void)resources, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, unit_guid()) != 0) {
        return NULL;
    }
    self = calloc(1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    self->own = unit_new();
    if (self->own == NULL) {
        free(self);
        return NULL;
    }
    self->functions = functions;
    if (name != NULL) {
        strncpy(self->name, name, sizeof self->name - 1);
    }
    return self;
}

EXPORTED void fmi2FreeInstance(fmi2Component c) {
    if (c != NULL) {
        free(((instance *)c)->own);
        free(c);
    }
}

EXPORTED fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                        fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    unit_start(((instance *)c)->own, start);
    return fmi2OK;
}

EXPORTED fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    const instance *self = c;
    return answered(self, unit_initialized(self->own));
}

EXPORTED fmi2Status fmi2Terminate(fmi2Component c) {
    (void)c;
    return fmi2OK;
}

EXPORTED fmi2Status fmi2Reset(fmi2Component c) {
    unit_reset(((instance *)c)->own);
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference at[], size_t count, fmi2Real value[]) {
    size_t k;
    for (k = 0; k < count; k++) {
        if (!unit_get(((const instance *)c)->own, at[k], &value[k])) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

EXPORTED fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                const fmi2Real value[]) {
    size_t k;
    for (k = 0; k < count; k++) {
        if (!unit_set(((instance *)c)->own, at[k], value[k])) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

EXPORTED fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                   fmi2Integer value[]) {
    size_t k;
    for (k = 0; k < count; k++) {
        if (!unit_get_integer(((const instance *)c)->own, at[k], &value[k])) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

EXPORTED fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_return) {
    const instance *self = c;
    (void)no_return;
    if (!(step >= 0.0) || !isfinite(time + step)) {
        return answered(self, "a step must be a finite time, s, and not negative");
    }
    return answered(self, unit_step(self->own, time, step));
}

/* What this unit has none of: other types of variables, states to save, derivatives, steps that go on. */
#define NO_VALUES(get, set, type)                                                                            \
    EXPORTED fmi2Status get(fmi2Component c, const fmi2ValueReference at[], size_t count, type value[]) {    \
        (void)c, (void)at, (void)value;                                                                      \
        return count ? fmi2Error : fmi2OK;                                                                   \
    }                                                                                                        \
    EXPORTED fmi2Status set(fmi2Component c, const fmi2ValueReference at[], size_t count, const type value[]) { \
        (void)c, (void)at, (void)value;                                                                      \
        return count ? fmi2Error : fmi2OK;                                                                   \
    }

NO_VALUES(fmi2GetBoolean, fmi2SetBoolean, fmi2Boolean)
NO_VALUES(fmi2GetString, fmi2SetString, fmi2String)

EXPORTED fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                   const fmi2Integer value[]) {
    (void)c, (void)at, (void)value;
    return count ? fmi2Error : fmi2OK;
}

EXPORTED fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c, (void)state;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    (void)c, (void)state;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c, (void)state;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c, (void)state, (void)size;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    (void)c, (void)state, (void)bytes, (void)size;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                            fmi2FMUstate *state) {
    (void)c, (void)bytes, (void)size, (void)state;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                                 const fmi2ValueReference known[], size_t knowns,
                                                 const fmi2Real change[], fmi2Real result[]) {
    (void)c, (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)change, (void)result;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                                const fmi2Integer order[], const fmi2Real value[]) {
    (void)c, (void)at, (void)count, (void)order, (void)value;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference at[], size_t count,
                                                 const fmi2Integer order[], fmi2Real value[]) {
    (void)c, (void)at, (void)count, (void)order, (void)value;
    return fmi2Error;
}

EXPORTED fmi2Status fmi2CancelStep(fmi2Component c) {
    (void)c;
    return fmi2Error;
}

#define NO_STATUS(name, type)                                                           \
    EXPORTED fmi2Status name(fmi2Component c, const fmi2StatusKind kind, type *value) { \
        (void)c, (void)kind, (void)value;                                               \
        return fmi2Discard;                                                             \
    }

NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetRealStatus, fmi2Real)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetBooleanStatus, fmi2Boolean)
NO_STATUS(fmi2GetStringStatus, fmi2String)
