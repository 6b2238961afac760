@chain /* The filters of this export. */
@chain enum { $kinds };
@chain 
typedef struct {
@chain     int filter;                 /* one of these */
$tuning_fields} kalscope_tuning;

typedef struct {
@plain     kalscope_tuning tuning; /* the copy in use: q, r and gate may be changed at any time */
@momentum     kalscope_tuning tuning; /* the copy in use: r and gate may be changed at any time */
@classic     kalscope_tuning tuning; /* the copy in use */
    kalscope_real x;        /* filtered value; NAN before the first sample */
$state_fields} kalscope_filter;
