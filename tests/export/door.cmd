set on_failure_script_quits 1
go_bmc
check_ltlspec_bmc_inc -k 22 -l -1
show_traces -p 4 -o trace.xml
quit
