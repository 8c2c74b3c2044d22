"""Many parts and many printers: jobs, one record of each, one manifest of all.

    jobs       what is asked, by the command line or a jobs.toml: Wanted -> Job (profiles read, parts hashed)
    make       one job from the part to the motor file -> its record, whatever happens
    local      jobs in this process or in several on this machine
    cluster    jobs on the workers of a Dask scheduler
    run        a batch from what is wanted to its manifest
    manifest   the records, kept as they come, written as manifest.json and manifest.csv at the end
"""
